"""A subscription's messages, however they were held up: no value is younger than it can be."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from asyncua import ua
from hypothesis import example, given, settings
from hypothesis import strategies as st

from abbe.drivers.link import Quality
from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.subscription.clock import ServerClock, seconds
from abbe.drivers.opcua.subscription.lost import SubscriptionLostError
from abbe.drivers.opcua.subscription.notified import (
    FIRST_CHANNEL,
    SERVER_CLOCK,
    SERVER_STATE,
    NotifiedChannels,
)
from abbe.drivers.opcua.subscription.services import Published

_EPOCH = datetime(2026, 11, 26, 6, 0, tzinfo=UTC)
_EVERY, _SAMPLING = 0.05, 0.025
_CALM = 0.004


def _stamp(at: float) -> datetime:
    return _EPOCH + timedelta(seconds=at)


def data(value: Any, stamp: datetime | None = None, code: int = 0) -> ua.DataValue:
    kind = ua.VariantType.DateTime if isinstance(value, datetime) else ua.VariantType.Double
    if isinstance(value, int):
        kind = ua.VariantType.Int32
    return ua.DataValue(
        ua.Variant(value, kind), ua.StatusCode(code), SourceTimestamp=stamp, ServerTimestamp=stamp
    )


def channels(stamp: str = "none", since: float = 99.9) -> NotifiedChannels:
    config = OpcuaConfig.model_validate(
        {
            "url": "opc.tcp://h", "subscribe": _EVERY, "stamp": stamp,
            "channels": {"x": {"node": "ns=1;s=x"}, "y": {"node": "ns=1;s=y"}},
        }
    )  # fmt: skip
    handles = {FIRST_CHANNEL: "x", FIRST_CHANNEL + 1: "y"}
    sampling = dict.fromkeys((SERVER_CLOCK, *handles), _SAMPLING)
    return NotifiedChannels(config, handles, {"x": float, "y": float}, sampling, _EVERY, since)


@dataclass
class Server:
    """A server whose axis x is where its true time is, and what its network makes of it.

    Attributes
    ----------
    now
        True time, s; ours.
    ahead
        s by which the server's clock is ahead.
    """

    ahead: float = 0.0
    now: float = 100.0
    stamped: bool = False
    sequence: int = 1
    _y: list[float] = field(default_factory=lambda: [1.0])

    def message(self, way: float, wait: float, back: float, **changed: Any) -> Published:
        """A Publish leaves, is `way` s on its way, waits in the server, and its answer returns."""
        asked_at = self.now
        self.now += way + wait
        sampled = self.now - _SAMPLING
        clock = _stamp(self.now + self.ahead)
        source = _stamp(sampled + self.ahead)
        changes = [(FIRST_CHANNEL, data(sampled, source)), (SERVER_CLOCK, data(clock))]
        if self._y:
            changes.append((FIRST_CHANNEL + 1, data(self._y.pop(), source)))
        self.now += back
        found = Published(
            7, self.sequence, clock, changes, "", False, asked_at, self.now, clock
        )._replace(**changed)
        self.sequence += bool(found.changes)
        return found


_WAYS = st.floats(0.0, 3.0) | st.just(0.001)


@given(
    stamp=st.sampled_from(["none", "source"]),
    said=st.booleans(),
    course=st.lists(
        st.tuples(_WAYS, st.floats(0.0, _EVERY), _WAYS, st.just(0.0) | st.floats(-5.0, 5.0)),
        min_size=1,
        max_size=12,
    ),
    ahead=st.floats(-1e6, 1e6),
)
@settings(max_examples=120, deadline=None)
def test_no_value_is_younger_than_it_can_be_however_slow_and_whatever_the_clock(
    stamp: str, said: bool, course: list[tuple[float, float, float, float]], ahead: float
) -> None:
    """The clock is set by any amount between any two messages, and they are held up by seconds."""
    server, notified, clock = Server(ahead), channels(stamp), ServerClock()
    for way, wait, back, step in course:
        message = server.message(way, wait, back)
        try:
            notified.take(message if said else message._replace(published_at=None), clock)
        except SubscriptionLostError:
            # made anew
            since = server.now
            notified, server._y, server.sequence = channels(stamp, since), [1.0], 1
            continue
        finally:
            server.ahead += step
        x = notified.samples["x"]
        assert x.good
        # it is the true moment at which it was sampled
        assert x.time <= x.value + 1e-5
        assert not said or x.time >= message.asked_at - _SAMPLING - 1e-5
        if stamp == "none":
            assert notified.samples["y"].time == pytest.approx(x.time)


def test_what_was_not_told_of_is_as_old_as_the_last_message_and_ages_without() -> None:
    server, notified, clock = Server(), channels(), ServerClock()
    for _ in range(3):
        assert notified.take(server.message(0.001, _EVERY, 0.001), clock)
    y = notified.samples["y"]
    assert y.value == 1.0
    assert y.time == pytest.approx(server.now - _EVERY - 0.002 - _SAMPLING)
    # without content, too
    quiet = server.message(0.001, _EVERY, 0.001, changes=[])
    assert notified.take(quiet, clock)
    assert notified.samples["y"].time == pytest.approx(quiet.asked_at - _SAMPLING)
    assert notified.samples["x"].time == pytest.approx(quiet.asked_at - _SAMPLING)


def test_a_message_that_waited_in_the_server_is_as_old_as_when_it_was_made() -> None:
    for stamp in ("none", "source"):
        server, notified, clock = Server(), channels(stamp), ServerClock()
        notified.take(server.message(0.001, _EVERY, 0.001), clock)
        held = server.message(0.001, 0.0, 0.0)
        made = server.now
        server.now += 2.0
        # answers a Publish of two seconds later
        late = held._replace(
            asked_at=server.now, arrived_at=server.now + 0.002, made_at=_stamp(server.now + 0.001)
        )
        assert notified.take(late, clock)
        x = notified.samples["x"]
        assert made - 0.1 < x.time <= x.value


def test_a_server_that_does_not_say_when_it_made_a_message_is_given_one_message_more() -> None:
    """As node-opcua does not."""
    server, notified, clock = Server(), channels(), ServerClock()
    notified.take(server.message(0.001, _EVERY, 0.001, published_at=None), clock)
    assert notified.samples["x"].time == pytest.approx(99.9 - _SAMPLING)
    before = server.message(0.001, _EVERY, 0.001, published_at=None)
    notified.take(before, clock)
    held = [server.message(0.0, 0.0, 0.0, published_at=None) for _ in range(3)]
    made = server.now
    # two seconds later they are fetched, one after the other: that more wait is said
    for i, each in enumerate(held):
        server.now += 2.0 if i == 0 else 0.01
        at = server.now
        late = each._replace(
            asked_at=at, arrived_at=at + 0.002, made_at=_stamp(at + 0.001), more=i < 2
        )
        assert notified.take(late, clock)
        assert notified.samples["x"].time <= made
        assert notified.samples["x"].time == pytest.approx(before.asked_at - _SAMPLING)
    fresh = server.message(0.001, _EVERY, 0.001, published_at=None)
    notified.take(fresh, clock)
    assert notified.samples["x"].time == pytest.approx(at - _SAMPLING)


def test_an_answer_that_carries_the_time_of_an_older_one_is_not_believed() -> None:
    server, notified, clock = Server(), channels("source"), ServerClock()
    notified.take(server.message(0.001, _EVERY, 0.001), clock)
    held = server.message(0.001, 0.0, 0.0)
    server.now += 2.0
    again = held._replace(asked_at=server.now, arrived_at=server.now + 0.002)
    with pytest.raises(SubscriptionLostError, match="clock was set by 2"):
        notified.take(again, clock)


def test_messages_that_are_repeated_count_once_and_missing_ones_end_it() -> None:
    server, notified, clock = Server(), channels(), ServerClock()
    first = server.message(0.001, _EVERY, 0.001)
    assert notified.take(first, clock)
    before = dict(notified.samples)
    second = server.message(0.001, _EVERY, 0.001)
    repeated = second._replace(sequence=first.sequence, changes=first.changes)
    assert not notified.take(repeated, clock)
    assert dict(notified.samples) == before
    assert notified.take(second, clock)
    server.sequence += 2
    with pytest.raises(SubscriptionLostError, match="2 of its messages did not come"):
        notified.take(server.message(0.001, _EVERY, 0.001), clock)


def test_a_first_message_that_is_missing_ends_it() -> None:
    """It alone tells of y, which stands still: nothing would be known of it for ever."""
    server, notified, clock = Server(), channels(), ServerClock()
    server.message(0.001, _EVERY, 0.001)
    with pytest.raises(SubscriptionLostError, match="its first message did not come"):
        notified.take(server.message(0.001, _EVERY, 0.001), clock)


def test_a_server_that_counts_from_elsewhere_and_tells_of_everything_is_taken() -> None:
    server, notified, clock = Server(sequence=5), channels(), ServerClock()
    assert notified.take(server.message(0.001, _EVERY, 0.001), clock)
    assert notified.take(server.message(0.001, _EVERY, 0.001), clock)


def test_numbers_begin_at_one_again() -> None:
    server, notified, clock = Server(sequence=(1 << 32) - 1), channels(), ServerClock()
    notified.take(server.message(0.001, _EVERY, 0.001), clock)
    server.sequence = 1
    assert notified.take(server.message(0.001, _EVERY, 0.001), clock)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"ended": "the server says of it: BadTimeout"}, "BadTimeout"),
        ({"made_at": None}, "do not say when they were made"),
        ({"published_at": _stamp(1e6)}, "later than it was answered"),
        ({"changes": [(99, data(1.0))]}, "a variable 99"),
    ],
)
def test_what_is_of_no_use(changed: dict[str, Any], why: str) -> None:
    with pytest.raises(SubscriptionLostError, match=why):
        channels().take(Server().message(0.001, _EVERY, 0.001, **changed), ServerClock())


def test_a_server_that_publishes_and_samples_no_longer_is_found_out() -> None:
    server, notified, clock = Server(), channels(), ServerClock()
    notified.take(server.message(0.001, _EVERY, 0.001), clock)

    def stuck() -> None:
        for _ in range(100):
            notified.take(server.message(0.001, _EVERY, 0.001, changes=[]), clock)

    with pytest.raises(SubscriptionLostError, match="has not sampled the server's own clock"):
        stuck()


def test_a_value_that_is_bad_in_the_server_is_bad_and_the_others_are_not() -> None:
    server, notified, clock = Server(), channels(), ServerClock()
    notified.take(server.message(0.001, _EVERY, 0.001), clock)
    bad = [(FIRST_CHANNEL, data(1.0, None, ua.StatusCodes.BadSensorFailure))]
    notified.take(server.message(0.001, _EVERY, 0.001, changes=bad), clock)
    assert notified.samples["x"].quality is Quality.BAD
    assert "BadSensorFailure" in notified.samples["x"].reason
    assert notified.samples["y"].good


def test_a_queue_that_overflowed_is_counted_and_its_newest_value_counts() -> None:
    server, notified, clock = Server(), channels(), ServerClock()
    over = [(FIRST_CHANNEL, data(4.0, None, 0x480)), (FIRST_CHANNEL, data(5.0))]
    notified.take(server.message(0.001, _EVERY, 0.001, changes=over), clock)
    assert notified.samples["x"].value == 5.0
    assert notified.overflowed == 1


def test_a_server_that_does_not_run_says_nothing_that_counts() -> None:
    server, notified, clock = Server(), channels(), ServerClock()
    notified.take(server.message(0.001, _EVERY, 0.001), clock)
    notified.take(server.message(0.001, _EVERY, 0.001, changes=[(SERVER_STATE, data(5))]), clock)
    assert {s.reason for s in notified.samples.values()} == {"the server says of itself: Test"}
    notified.take(server.message(0.001, _EVERY, 0.001, changes=[(SERVER_STATE, data(0))]), clock)
    assert all(s.good for s in notified.samples.values())


@example([(0.0, 1.0, 0.0), (0.0, 0.0, 0.0)])
@given(st.lists(st.tuples(_WAYS, _WAYS, st.floats(0.0, 60.0)), min_size=1, max_size=20))
def test_a_clock_that_runs_a_little_fast_is_not_said_to_have_been_set(
    answers: list[tuple[float, float, float]],
) -> None:
    clock, now = ServerClock(), 100.0
    for way, back, pause in answers:
        asked_at, made_at, now = now, now + way, now + way + back
        clock.answered(asked_at, now, seconds(_stamp(made_at * 1.0002)))
        assert clock.earliest(seconds(_stamp(made_at * 1.0002))) <= made_at + 1e-5
        now += pause


@pytest.mark.parametrize("step", [0.2, -0.2, 30.0, -30.0])
def test_a_clock_that_was_set_is_found_and_then_believed_again(step: float) -> None:
    clock = ServerClock()
    clock.answered(1.0, 1.002, 500.0)
    with pytest.raises(SubscriptionLostError, match=r"was set by 0\.[12]|was set by (29|30)"):
        clock.answered(2.0, 2.002, 501.0 + step)
    clock.answered(3.0, 3.002, 502.0 + step)
