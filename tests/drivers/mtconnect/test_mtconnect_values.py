"""What an agent says becomes samples: numbers, what is missing, how old it is."""

from __future__ import annotations

import asyncio
import contextlib
import time
from datetime import timedelta
from typing import Any

import pytest

from abbe.drivers.link import LinkConfigError, LinkError, LinkState, Quality
from abbe.drivers.mtconnect.link import MtconnectLink
from tests.support.drivers.mtconnect.agent import MillAgent, linked, section
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


async def test_what_changes_is_followed(agent: MillAgent) -> None:
    async with linked(agent) as link:
        found = await link.read(("x", "T"))
        assert [found[name].value for name in ("x", "T")] == [1.5, 20.25]
        agent.say(Xact="-7.25e-1")
        before = time.monotonic()
        found = await link.read(("x", "T"))
        # what did not change is as it was, and both are of this question
        assert [found[name].value for name in ("x", "T")] == [-0.725, 20.25]
        assert all(before <= found[name].time <= time.monotonic() for name in ("x", "T"))
        assert (await link.read(("x",)))["x"].value == -0.725
    kinds = [target.split("?")[0].rpartition("/")[2] for target in agent.asked]
    assert kinds == ["probe", "current", "sample", "sample", "sample"]
    assert agent.connections == 1
    assert all("from=14&" in target for target in agent.asked[2:4])
    assert "from=15&" in agent.asked[4]


async def test_all_of_a_bufferful_is_one_answer_and_more_is_asked_anew(agent: MillAgent) -> None:
    async with linked(agent) as link:
        # three times: what it kept since the last question is overwritten
        for n in range(3 * agent.size):
            agent.say(Xact=n)
        assert (await link.read(("x",)))["x"].value == 3 * agent.size - 1
        kinds = [target.split("?")[0].rpartition("/")[2] for target in agent.asked]
        assert kinds == ["probe", "current", "sample", "current"]
        agent.say(Xact=0.5)
        assert (await link.read(("x",)))["x"].value == 0.5


async def test_what_was_overwritten_unsaid_is_asked_for(agent: MillAgent) -> None:
    agent.silent = True
    async with linked(agent) as link:
        agent.say(Stemp="30")
        for n in range(agent.size):
            agent.say(Xact=n)
        # the temperature is in none of those that it kept
        found = await link.read(("x", "T"))
        assert [found[name].value for name in ("x", "T")] == [agent.size - 1, 30.0]


async def test_who_is_behind_asks_what_is_so_now(agent: MillAgent) -> None:
    agent.size = 2000
    async with linked(agent) as link:
        for n in range(1200):
            agent.say(Xact=n)
        assert (await link.read(("x",)))["x"].value == 1199
        assert "/current" in agent.asked[-1]


@pytest.mark.parametrize("version", ["1.2", "1.8", "2.3"])
async def test_documents_of_all_versions(agent: MillAgent, version: str) -> None:
    agent.version = version
    async with linked(agent) as link:
        for n in range(100):
            agent.say(Xact=n)
        assert (await link.read(("x",)))["x"].value == 99


@pytest.mark.parametrize(
    ("item", "text", "more", "quality", "why"),
    [
        (None, "UNAVAILABLE", "", Quality.UNAVAILABLE, "the agent says UNAVAILABLE"),
        (None, "", "", Quality.BAD, "is no number"),
        (None, "on", "", Quality.BAD, "is no number: 'on'"),
        (None, "nan", "", Quality.BAD, "is no number"),
        (None, "1_0", "", Quality.BAD, "is no number"),
        (None, "1e999", "", Quality.BAD, "is inf"),
        (None, "١", "", Quality.BAD, "is no number"),
        (None, "1 2 3", "", Quality.BAD, "say which item"),
        (4, "1 2 3", "", Quality.BAD, "item 4 of 3"),
        (1, "1 2 3", 'sampleCount="3" sampleRate="100"', Quality.BAD, "time series"),
        (None, '<Entry key="a">1</Entry>', 'count="1"', Quality.BAD, "entries of its own"),
        (None, "1.0", 'quality="INVALID"', Quality.BAD, "INVALID"),
        (2, "1 2 3", "", Quality.GOOD, ""),
        (None, " 2\n", 'quality="VALID"', Quality.GOOD, ""),
    ],
)
async def test_what_is_a_value(
    agent: MillAgent, item: int | None, text: str, more: str, quality: Quality, why: str
) -> None:
    channel: dict[str, Any] = {"data": "Xact"} | ({"item": item} if item else {})
    async with linked(agent, channels={"x": channel, "T": {"data": "Stemp"}}) as link:
        agent.say(Xact=text, more=more)
        found = await link.read(("x", "T"))
        assert (found["x"].quality, found["T"].value) == (quality, 20.25)
        assert why in found["x"].reason
        assert found["x"].value == 2.0 or not found["x"].good
        # and it is over when a number follows
        agent.say(Xact="2" if item is None else "2 2 2 2")
        assert (await link.read(("x",)))["x"].value == 2.0


async def test_an_observation_is_as_old_as_its_stamp_by_the_agent_s_own_clock(
    agent: MillAgent,
) -> None:
    # an agent's clock need not be right
    agent.clock = timedelta(days=-400)
    agent.forget()
    agent.say(Stemp="20")
    async with linked(agent, stamp="observation") as link:
        agent.say(age=30.0, Xact="4")
        before = time.monotonic()
        found = await link.read(("x", "T"))
        assert before - 31.0 < found["x"].time <= time.monotonic() - 30.0
        assert found["T"].time > before - 10.0
        # reported once, it grows older while the axis stands still
        await asyncio.sleep(0.2)
        later = await link.read(("x",))
        assert later["x"].time == pytest.approx(found["x"].time, abs=0.1)
        agent.say(age=-3.0, Xact="4")
        found = await link.read(("x", "T"))
        assert found["x"].quality is Quality.BAD
        assert "later than the answer itself" in found["x"].reason
    # with documents stamped in whole seconds it may be a second older than it looks
    agent.creation_digits = 0
    async with linked(agent, stamp="observation") as link:
        agent.say(age=30.0, Xact="4")
        found = await link.read(("x",))
        now = time.monotonic()
        assert now - 31.5 < found["x"].time <= now - 30.0
        agent.say(Xact="4")
        found = await link.read(("x",))
        assert found["x"].good
        assert found["x"].age() < 2.0


async def test_a_late_answer_is_as_old_as_its_question(agent: MillAgent) -> None:
    async with linked(agent) as link:

        def late(target: str) -> list[bytes] | None:
            answer = agent.answer(target)
            time.sleep(0.4)
            # in pieces, one of them inside a tag
            return [answer[:9], answer[9:200], answer[200:]]

        agent.instead = late
        before = time.monotonic()
        found = await link.read(("x",))
        assert found["x"].value == 1.5
        assert found["x"].time < before + 0.2
        assert found["x"].age() >= 0.4


async def test_units_that_differ_are_refused_in_one_line(agent: MillAgent) -> None:
    agent.units["Xact"] = "INCH"
    link = MtconnectLink("mill", section(agent))
    with pytest.raises(LinkConfigError) as caught:
        await link.open()
    said = "link mill: channel x: unit 'mm', but the agent states 'INCH' for Xact"
    assert (str(caught.value), caught.value.field) == (said, ("channels", "x", "unit"))
    await link.close()
    scaled = {"x": {"data": "Xact", "unit": "mm", "scale": 25.4}}
    for keys in ({"units": False}, {"channels": scaled}, {"channels": {"x": {"data": "Xact"}}}):
        async with linked(agent, **keys) as link:
            assert (await link.read(("x",)))["x"].good


@pytest.mark.parametrize(
    ("data", "unit", "right"),
    [
        ("Xact", "mm", True), ("Ppos", "mm", True), ("Cact", "deg", True), ("Stemp", "degC", True),
        ("mode", "mm", True), ("Xact", "MILLIMETER", True), ("Xact", "in", False),
        ("Xact", "µm", False), ("Cact", "rad", False), ("Stemp", "K", False),
        ("Xact", "divisions", False), ("Stemp", "mm", False),
    ],
)  # fmt: skip
async def test_units(agent: MillAgent, data: str, unit: str, right: bool) -> None:
    link = MtconnectLink("mill", section(agent, channels={"c": {"data": data, "unit": unit}}))
    said = "" if right else "but the agent states"
    try:
        with pytest.raises(LinkConfigError, match=said) if said else contextlib.nullcontext():
            await link.open()
    finally:
        await link.close()


async def test_a_data_item_that_is_not_there_is_refused(agent: MillAgent) -> None:
    link = MtconnectLink("mill", section(agent, channels={"x": {"data": "Xakt"}}))
    with pytest.raises(LinkConfigError, match="the agent has no data item 'Xakt': see http://"):
        await link.open()
    await link.close()


async def test_an_agent_that_is_tested_is_not_believed(agent: MillAgent) -> None:
    async with linked(agent) as link:
        agent.header = 'testIndicator="true"'
        found = await link.read(("x",))
        assert (found["x"].quality, link.status.state) == (Quality.BAD, LinkState.DEGRADED)
        agent.header = 'testIndicator="false"'
        assert (await link.read(("x",)))["x"].good
        assert link.status.state is LinkState.UP


async def test_it_only_reads_and_at_its_pace(agent: MillAgent) -> None:
    async with linked(agent, every=60.0) as link:
        first = await link.read(("x", "T"))
        asked = len(agent.asked)
        agent.say(Xact="9")
        assert await link.read(("x", "T")) == first
        assert len(agent.asked) == asked
        assert link.info("x").every == 60.0
        with pytest.raises(LinkError, match="only reads"):
            await link.write({"x": 1.0})
        with pytest.raises(LinkConfigError, match="no channel 'q'"):
            await link.read(("q",))


async def test_without_an_xpath_all_is_asked_for(agent: MillAgent) -> None:
    async with linked(agent, select=False) as link:
        agent.say(Xact="9")
        assert (await link.read(("x",)))["x"].value == 9.0
    assert not any("path=" in target for target in agent.asked)


async def test_an_agent_that_starts_again(agent: MillAgent) -> None:
    async with linked(agent) as link:
        assert (await link.read(("x",)))["x"].good
        # with a count that goes on: only the instance tells
        agent.instance += 1
        agent.say(Xact="8")
        assert (await link.read(("x",)))["x"].value == 8.0
        kinds = [target.split("?")[0].rpartition("/")[2] for target in agent.asked[-3:]]
        assert kinds == ["sample", "probe", "current"]
        # anew, in other units: nothing of it is used
        agent.instance += 1
        agent.units["Xact"] = "INCH"
        found = await link.read(("x",))
        assert not found["x"].good
        assert "states 'INCH'" in found["x"].reason
        agent.units.clear()
        await until(lambda: link.status.state is LinkState.UP)
        # fewer than before
        agent.instance += 1
        agent.forget()
        agent.say(Xact="7")
        assert (await link.read(("x",)))["x"].value == 7.0
