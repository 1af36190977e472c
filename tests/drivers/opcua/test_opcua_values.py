"""What node-opcua says of a variable becomes a number, a quality and an age."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest

from abbe.drivers.link import LinkConfigError, LinkError, LinkState, Quality
from tests.support.drivers.opcua.mill import Mill, linked, node

pytestmark = pytest.mark.integration


async def test_numbers_of_every_kind(server: Mill) -> None:
    channels = {
        "x": node("x", unit="mm"),
        "T": node("T", unit="degC", scale=2.0, offset=1.0),
        "flag": "flag",
        "n": "n",
        "big": "big",
        "second": node("arr", item=2),
        "by_number": {"node": f"ns={server.namespace};s=Mill/y"},
    }
    async with linked(server.url, channels) as link:
        samples = await link.read(tuple(channels))
    assert {name: s.value for name, s in samples.items()} == {
        "x": 1.5, "T": 41.5, "flag": 1.0, "n": -7.0, "big": 12.0, "second": 2.0, "by_number": 2.5,
    }  # fmt: skip
    assert all(s.good for s in samples.values())


@pytest.mark.parametrize(
    ("channel", "said", "why"),
    [
        ({"node": "ns=0;s=Nobody"}, {}, "BadNodeIdUnknown"),
        ("x", {"x": {"value": 1.0, "status": "BadDeviceFailure"}}, "BadDeviceFailure"),
        ("x", {"x": {"value": 1.0, "status": "UncertainLastUsableValue"}}, "UncertainLastUsable"),
        ("x", {"x": {"value": 1.0, "status": "GoodClamped"}}, "clamped"),
        ("x", {"x": {"value": 1.0, "status": "GoodLocalOverride"}}, "overridden by hand"),
        ("x", {"x": {"value": 1.0, "status": "Good", "bits": 0x500}}, "held at a limit"),
        ("x", {"x": {"value": 1.0, "source_age": -5.0}}, "later than the answer"),
        ("text", {}, "is no number"),
        ("arr", {}, "is an array of 3: say which item"),
        (node("arr", item=4), {}, "item 4 of an array of 3"),
        (node("x", item=1), {}, "is no array"),
    ],
)
async def test_what_is_no_measured_number_is_bad(
    server: Mill, channel: Any, said: dict[str, Any], why: str
) -> None:
    server.say(**said)
    async with linked(server.url, {"it": channel, "y": "y"}) as link:
        samples = await link.read(("it", "y"))
    assert samples["it"].quality is Quality.BAD
    assert math.isnan(samples["it"].value)
    assert why in samples["it"].reason
    assert samples["y"].value == 2.5


async def test_not_a_number_of_the_server_is_bad(server: Mill) -> None:
    async with linked(server.url, {"x": node("x", scale=1e308)}) as link:
        server.say(x={"value": 1e300})
        found = (await link.read(("x",)))["x"]
    assert not found.good
    assert "inf" in found.reason


async def test_a_value_that_was_old_at_its_source_is_as_old(server: Mill) -> None:
    server.say(x={"value": 1.0, "source_age": 3.0}, y={"value": 2.0})
    async with linked(server.url, {"x": "x", "y": "y"}) as link:
        before = time.monotonic()
        samples = await link.read(("x", "y"))
        after = time.monotonic()
    assert before - 3.1 <= samples["x"].time <= after - 2.9
    assert before - 0.1 <= samples["y"].time <= after


async def test_the_server_s_own_stamp_is_when_it_answered(server: Mill) -> None:
    # node-opcua stamps whatever it has with the moment of the answer: a reason for the default
    server.say(x={"value": 1.0, "server_age": 3.0, "source_age": 3.0})
    async with linked(server.url, {"x": "x"}, stamp="server") as link:
        before = time.monotonic()
        found = (await link.read(("x",)))["x"]
    assert found.time >= before - 0.1


async def test_without_stamps_a_value_is_as_old_as_its_question(server: Mill) -> None:
    server.say(x={"value": 1.0, "server_age": 3.0, "source_age": 9.0})
    async with linked(server.url, {"x": "x"}, stamp="none") as link:
        before = time.monotonic()
        found = (await link.read(("x",)))["x"]
    assert found.good
    assert found.time >= before


async def test_a_value_without_the_stamp_that_is_asked_for_is_bad(server: Mill) -> None:
    server.say(x={"value": 1.0, "source_age": None})
    async with linked(server.url, {"x": "x"}) as link:
        found = (await link.read(("x",)))["x"]
    assert found.quality is Quality.BAD
    assert "carries no source time stamp" in found.reason


@pytest.mark.parametrize("state", [1, 3, 4, 5])
async def test_a_server_that_says_it_does_not_run_is_not_believed(server: Mill, state: int) -> None:
    async with linked(server.url, {"x": "x"}) as link:
        assert (await link.read(("x",)))["x"].good
        server.say(state)
        found = (await link.read(("x",)))["x"]
        assert found.quality is Quality.BAD
        assert "the server says of itself" in found.reason
        assert link.status.state is LinkState.DEGRADED
        server.say(0)
        assert (await link.read(("x",)))["x"].good
        assert link.status.state is LinkState.UP


async def test_another_unit_than_the_server_states_is_refused(server: Mill) -> None:
    with pytest.raises(LinkConfigError, match="channel x: unit 'mm', but the server states 'in'"):
        async with linked(server.url, {"x": node("inch", unit="mm")}):
            pass
    with pytest.raises(LinkConfigError, match="unit 'degF', but the server states 'degC'"):
        async with linked(server.url, {"T": node("T", unit="degF")}):
            pass
    # scaled, the unit is that of the result; and who knows better may say so
    async with linked(server.url, {"x": node("inch", unit="mm", scale=25.4)}) as link:
        assert (await link.read(("x",)))["x"].value == 25.4
    async with linked(server.url, {"x": node("inch", unit="mm")}, units=False) as link:
        assert (await link.read(("x",)))["x"].value == 1.0


async def test_each_is_read_at_its_pace_and_a_group_never_apart(server: Mill) -> None:
    channels = {"x": "x", "y": "y", "T": node("T", every=60.0)}
    async with linked(server.url, channels) as link:
        link.keep_together(("x", "y"), one_sample=True)
        with pytest.raises(LinkConfigError, match="the same every"):
            link.keep_together(("x", "T"), one_sample=True)
        first = await link.read(tuple(channels))
        server.say(T={"value": 30.0}, x={"value": 9.0}, y={"value": 8.0})
        second = await link.read(("x", "T"))
        assert (second["x"].value, second["T"]) == (9.0, first["T"])
        assert link.status.requests == 2


async def test_groups_that_share_a_channel_are_one(server: Mill) -> None:
    channels = {name: node(name, every=60.0) for name in "xyz"}
    async with linked(server.url, channels) as link:
        link.keep_together(("x", "y"))
        link.keep_together(("y", "z"))
        await link.read(("x",))
        server.say(z={"value": 9.0})
        # it came with x already
        assert (await link.read(("z",)))["z"].value == 3.5
        assert link.status.requests == 1


async def test_nothing_is_written(server: Mill) -> None:
    async with linked(server.url, {"x": "x"}) as link:
        await link.write({})
        with pytest.raises(LinkError, match="only reads") as raised:
            await link.write({"x": 1.0})
        assert raised.value.untouched == {"x"}
        with pytest.raises(LinkConfigError, match="no channel 'q'"):
            await link.read(("q",))
