"""Signals of a DBC file over a simulated slcan adapter in its own process."""

from __future__ import annotations

import asyncio
import logging
import struct
from collections.abc import Iterator

import pytest

from abbe.drivers.can.dbc.bus import MessageBus
from abbe.drivers.link import LinkDownError, LinkError, LinkState, Quality
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.can.links import ASK_Z, CORRECTION, READ, Z, all_good, linked
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can", "--frames", "0.01") as process:
        yield process


@pytest.fixture
def own_bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can", "--frames", "0.01") as process:
        yield process


async def test_signals_are_read(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        samples = await all_good(link, tuple(READ))
        # Motorola byte order, signed
        assert samples["T_left"].value == pytest.approx(21.5)
        assert samples["T_right"].value == pytest.approx(-3.25)
        # latched together: Y is exactly 1000 mm further
        assert samples["position_y"].value - samples["x"].value == pytest.approx(1000.0)
        assert samples["y_um"].value == pytest.approx(1000.0 * samples["position_y"].value)
        assert samples["x"].time == samples["position_y"].time
        assert link.info("x").unit == "mm"
        assert link.info("y_um").unit == "um"
        assert link.info("T_left").unit == "degC"
        assert "signal position_x of POSITION (201h)" in link.channels["x"]


async def test_values_move_on(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ) as link:
        seen = set()
        while len(seen) < 5:
            seen.add((await all_good(link, ("x",)))["x"].value)
            await asyncio.sleep(0.01)


async def test_a_file_says_when_a_message_is_missing(bus: SimulatedProcess) -> None:
    """POSITION has a cycle time of 10 ms there: three of them, but at least 0.1 s."""
    messages = {"POSITION": {}, "TEMPERATURES": {"within": 7.0}}
    async with linked(bus.ready, READ, messages=messages) as link:
        assert link.channels["x"].endswith("missing after 0.1 s, in mm")
        assert link.channels["T_left"].endswith("missing after 7 s, in degC")


async def test_pages_of_a_multiplexed_message_in_a_frame_with_a_long_id(
    bus: SimulatedProcess,
) -> None:
    channels = {"supply": {"message": "DIAGNOSIS"}, "hours": {"message": "DIAGNOSIS"}}
    async with linked(bus.ready, channels) as link:
        samples = await all_good(link, ("supply", "hours"))
        assert [s.value for s in samples.values()] == [pytest.approx(24.1), 12345.0]
        # two frames; that both waited together in the serial port may happen, not for ever
        while samples["supply"].time == samples["hours"].time:
            await asyncio.sleep(0.01)
            samples = await all_good(link, ("supply", "hours"))
        assert "18FF0012h" in link.channels["supply"]


async def test_a_page_that_does_not_come_any_more_is_missing(own_bus: SimulatedProcess) -> None:
    channels = {"supply": {"message": "DIAGNOSIS"}, "hours": {"message": "DIAGNOSIS"}}
    async with linked(own_bus.ready, channels) as link:
        await all_good(link, ("supply", "hours"))
        own_bus.order("page", only=0)

        async def missing() -> bool:
            samples = await link.read(("supply", "hours"))
            reason = "message DIAGNOSIS comes, but its page with hours does not"
            return samples["supply"].good and samples["hours"].reason == reason

        await until(missing)
        assert link.status.state is LinkState.UP


async def test_a_message_that_is_asked_for(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ | Z, messages=ASK_Z) as link:
        before = link.status.requests
        first = (await link.read(("x", "position_z")))["position_z"]
        assert first.good
        await asyncio.sleep(0.02)
        second = (await link.read(("position_z",)))["position_z"]
        assert second.value != first.value
        assert second.time > first.time
        assert link.status.requests - before == 2
        assert link.status.round_trip > 0.0
    frame = {"id": 0x203, "data": ""}
    request = {"POSITION_Z": {"request": frame}}
    async with linked(bus.ready, Z, messages=request, timeout=0.2) as link:
        # a data frame of that id is not what this device answers
        assert link.status.state is LinkState.DOWN
        assert "no request is answered" in link.status.detail


async def test_messages_are_sent(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ | CORRECTION) as link:
        also = "CORRECTION also carries correction_y, correction_z, life, whose last value"
        with pytest.raises(LinkError, match=also) as alone:
            await link.write({"correction_x": 0.1})
        assert alone.value.untouched == {"correction_x"}
        await link.write(
            {"correction_x": 0.1, "correction_y": -0.2, "correction_z": 0.0003, "life": 7}
        )
        again = {"correction_x": 0.1, "correction_y": -0.2, "correction_z": 0.0003}
        await link.write(again | {"life": 8})

        def sent() -> bool:
            return bus.order("report")["setpoints"][-2:] == [
                struct.pack("<hhhBx", 1000, -2000, 3, 7).hex(),
                struct.pack("<hhhBx", 1000, -2000, 3, 8).hex(),
            ]

        await until(sent)
        with pytest.raises(LinkError, match="nothing written; CORRECTION: .*correction_x.*5"):
            await link.write(again | {"life": 9, "correction_x": 5.0})
        with pytest.raises(LinkError, match="nothing written; not writable: x"):
            await link.write({"life": 9, "x": 1.0})
        assert sent()
        assert (await link.read(("life",)))["life"].quality is Quality.BAD


async def test_an_adapter_unplugged_and_plugged_in(
    own_bus: SimulatedProcess, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "abbe")
    async with linked(own_bus.ready, READ | CORRECTION) as link:
        own_bus.order("unplug")
        await until(lambda: link.status.state is LinkState.DOWN)
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        with pytest.raises(LinkDownError, match="not written: correction_x"):
            await link.write(dict.fromkeys(CORRECTION, 1.0))
        own_bus.order("plug")
        await until(lambda: link.status.state is LinkState.UP)
        await all_good(link, ("x",))
    said = [r.getMessage() for r in caplog.records if r.name.startswith("abbe")]
    assert ["lost: receiving failed" in said[0], "back after" in said[-1], len(said)] == [
        True, True, 2,
    ]  # fmt: skip


async def test_an_adapter_that_forgot_that_it_was_opened(own_bus: SimulatedProcess) -> None:
    """No error anywhere, just silence: opening it again is what helps."""
    async with linked(own_bus.ready, READ) as link:
        own_bus.order("reset_adapter")
        await until(lambda: link.status.state is LinkState.DOWN)
        assert "nothing comes" in link.status.detail
        await until(lambda: link.status.state is LinkState.UP)
        assert link.status.reconnects >= 1
        await all_good(link, ("x",))


async def test_without_our_watch_that_would_last_for_ever(
    own_bus: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MessageBus, "_look", lambda self, due: None)
    async with linked(own_bus.ready, READ) as link:
        own_bus.order("reset_adapter")

        async def missing() -> bool:
            return not (await link.read(("x",)))["x"].good

        await until(missing)
        await asyncio.sleep(0.3)
        assert link.status.state is LinkState.UP


async def test_cyclic_messages_stop_and_what_is_asked_for_goes_on(
    own_bus: SimulatedProcess,
) -> None:
    async with linked(own_bus.ready, READ | Z, messages=ASK_Z) as link:
        own_bus.order("mute", muted=True)
        await until(lambda: link.status.state is LinkState.DEGRADED)
        await until(lambda: len(link.status.quarantined) == 2)
        assert set(link.status.quarantined) == {"message POSITION", "message TEMPERATURES"}
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "POSITION did not come for" in sample.reason
        own_bus.order("mute", muted=False)
        await until(lambda: link.status.state is LinkState.UP)


async def test_an_unanswered_request_costs_one_time_out(own_bus: SimulatedProcess) -> None:
    patience = {"timeout": 0.3, "quarantine_after": 100, "late_reply_max": 60.0}
    async with linked(own_bus.ready, READ | Z, messages=ASK_Z, **patience) as link:
        own_bus.order("deaf_adapter", deaf=True)
        samples = await link.read(("x", "position_z"))
        assert samples["x"].good
        assert samples["position_z"].quality is Quality.UNAVAILABLE
        assert "no answer in 0.3 s" in samples["position_z"].reason
        # its answer might still come and is not to pass for the next one's
        asked = link.status.requests
        sample = (await link.read(("position_z",)))["position_z"]
        assert sample.reason == "message POSITION_Z may still be answered late"
        assert link.status.requests == asked


async def test_a_request_is_answered_again(own_bus: SimulatedProcess) -> None:
    async with linked(own_bus.ready, READ | Z, messages=ASK_Z, timeout=0.3) as link:
        own_bus.order("deaf_adapter", deaf=True)
        assert not (await link.read(("position_z",)))["position_z"].good
        own_bus.order("deaf_adapter", deaf=False)
        await all_good(link, ("position_z",))


async def test_a_second_link_on_the_same_adapter_is_refused_with_the_reason(
    bus: SimulatedProcess,
) -> None:
    async with linked(bus.ready, READ) as first, linked(bus.ready, READ) as second:
        await until(lambda: "another program has it" in second.status.detail)
        assert second.status.state is LinkState.DOWN
        await asyncio.sleep(0.3)
        await until(lambda: first.status.state is LinkState.UP)
        assert first.status.reconnects == 0


async def test_an_adapter_that_is_not_there() -> None:
    ready = {"interface": "slcan", "channel": "/dev/abbe-no-such-port"}
    async with linked(ready, READ) as down:
        assert "No such file" in down.status.detail
