"""An I++ DME link against the simulated server in a process of its own, over TCP."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from abbe.drivers.ipp.config import IppConfig
from abbe.drivers.ipp.link import IppLink
from abbe.drivers.link import LinkConfigError, LinkError, LinkState, Quality
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.ipp_links import (
    AXES,
    PART,
    PATIENT,
    REPORT,
    SCALES,
    STANDING,
    TIP,
    good,
    linked,
    read_until,
    section,
    standing,
)
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

READ_ONLY = ("StartSession", "EndSession", "Get", "OnMoveReportE", "StopDaemon")
"""Beginnings of all commands that the link may send by itself."""


@pytest.fixture
def cmm() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("ipp", *STANDING) as process:
        yield process


async def test_positions_and_temperatures_come_and_the_session_is_ended(
    cmm: SimulatedProcess,
) -> None:
    async with linked(cmm, AXES | SCALES | PART) as link:
        assert link.status.state is LinkState.UP
        await standing(link)
        samples = await link.read(tuple(link.channels))
        assert all(sample.good for sample in samples.values()), samples
        for name, at in zip("xyz", TIP, strict=True):
            assert samples[name].value == pytest.approx(at, abs=1e-4)
        for name in (*SCALES, *PART):
            assert 18.0 < samples[name].value < 21.0
        assert link.status.round_trip < PATIENT
        assert link.status.state is LinkState.UP
    commands = cmm.order("report")["commands"]
    assert commands[0] == "StartSession()"
    assert commands[-1] == "EndSession()"
    assert "GetCoordSystem()" in commands
    assert "Get(X(), Y(), Z())" in commands
    assert "GetScaleTemperatures(X(), Y(), Z())" in commands
    assert "GetProp(Part.Temperature())" in commands
    assert all(command.startswith(READ_ONLY) for command in commands)
    await until(lambda: cmm.order("report")["clients"] == 0)


async def test_slow_channels_are_not_asked_at_every_call(cmm: SimulatedProcess) -> None:
    slow = {name: part | {"every": 60.0} for name, part in (SCALES | PART).items()}
    async with linked(cmm, AXES | slow) as link:
        first = await link.read(tuple(link.channels))
        again = await link.read(tuple(link.channels))
        assert again["T_part"].time == first["T_part"].time
        assert again["x"].time > first["x"].time
        commands = cmm.order("report")["commands"]
        assert sum("Temperature" in command for command in commands) == 2


async def test_channels_of_properties_of_angles_and_of_a_rotary_table() -> None:
    channels: dict[str, Any] = {
        "r": {"axis": "R"},
        "b": {"axis": "Tool.B", "scale": math.pi / 180.0, "unit": "rad"},
        "z_head": {"axis": "Z", "offset": 150.0},
        "tool_z": {"property": "Tool.AvrOffsets", "item": 3, "unit": "mm"},
        "k": {"property": "Tool.Alignment", "item": 3},
        "too_many": {"property": "Tool.Alignment", "item": 4},
        "name": {"property": "Tool.Name"},
    }
    with SimulatedProcess("ipp", "--rotary", *STANDING) as cmm:
        async with linked(cmm, channels) as link:
            samples = await link.read(tuple(channels))
            assert 0.0 <= samples["r"].value < 360.0
            assert samples["b"].value == pytest.approx(math.pi / 2)
            assert samples["tool_z"].value == -150.0
            assert samples["k"].value == 1.0
            assert samples["too_many"].quality is Quality.BAD
            assert "3 values, and number 4 is wanted" in samples["too_many"].reason
            assert samples["name"].quality is Quality.BAD
            assert 'found "Probe1", expected a number' in samples["name"].reason
            assert link.info("r").unit == "deg"
            assert link.info("b").unit == "rad"
            await until(_at(link, "z_head", -1.0))


def _at(link: IppLink, name: str, value: float) -> Any:
    async def reached() -> bool:
        sample = (await link.read((name,)))[name]
        return sample.good and abs(sample.value - value) < 1e-4

    return reached


async def test_positions_sent_by_the_server() -> None:
    with SimulatedProcess("ipp") as cmm:
        async with linked(cmm, AXES | PART, **REPORT) as link:
            assert link.status.state is LinkState.UP
            assert link.info("x").every == 0.1
            places: list[float] = []
            times: list[float] = []

            async def moved() -> bool:
                samples = await link.read(("x", "y", "z", "T_part"))
                assert all(sample.good for sample in samples.values()), samples
                assert len({samples[name].time for name in "xyz"}) == 1
                if samples["x"].value not in places:
                    places.append(samples["x"].value)
                    times.append(samples["x"].time)
                return len(places) > 10

            await until(moved)
            # two that were read at once were not sent before the same moment
            assert times == sorted(times)
            assert len(set(times)) > 1
        commands = cmm.order("report")["commands"]
        assert "OnMoveReportE(Time(0.1), Dis(0.05), X(), Y(), Z())" in commands
        assert not any(command.startswith("Get(") for command in commands)
        assert commands[-2:] == ["StopDaemon(E0001)", "EndSession()"]


async def test_a_standing_machine_reports_too(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES, **REPORT) as link:
        await standing(link)
        first = (await link.read(("x",)))["x"].time
        await until(_later(link, first + 0.5))


def _later(link: IppLink, time: float) -> Any:
    async def later() -> bool:
        sample = (await link.read(("x",)))["x"]
        return sample.good and sample.time > time

    return later


async def test_positions_of_another_coordinate_system_are_bad(
    cmm: SimulatedProcess, caplog: pytest.LogCaptureFixture
) -> None:
    async with linked(cmm, AXES | PART, coordinates_every=0.0) as link:
        await read_until(link, ("x", "T_part"), good)
        cmm.order("coordinates", name="PartCsy")
        samples = await link.read(("x", "T_part"))
        assert samples["T_part"].good
        assert samples["x"].quality is Quality.BAD
        assert samples["x"].reason == "positions are in PartCsy, and MachineCsy is wanted"
        assert link.status.state is LinkState.DEGRADED
        cmm.order("coordinates", name="MachineCsy")
        await read_until(link, ("x",), good)
        assert link.status.state is LinkState.UP
    assert sum("PartCsy" in r.getMessage() for r in caplog.records) == 1
    async with linked(cmm, AXES, coordinates="any") as link:
        cmm.order("coordinates", name="PartCsy")
        await read_until(link, ("x",), good)


async def test_nothing_is_ever_written(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES) as link:
        await link.write({})
        with pytest.raises(LinkError, match="x: an I\\+\\+ DME link only reads"):
            await link.write({"x": 1.0})
        assert not link.info("x").writable


async def test_unknown_channels_are_errors(cmm: SimulatedProcess) -> None:
    link = IppLink("bench", section(cmm, AXES))
    with pytest.raises(LinkConfigError, match="no channel 'q'; there are: x, y, z"):
        await link.read(("q",))


async def test_open_and_close_twice_and_reading_when_closed(cmm: SimulatedProcess) -> None:
    link = IppLink("bench", section(cmm, AXES))
    assert (await link.read(("x",)))["x"].quality is Quality.UNAVAILABLE
    await link.open()
    await link.open()
    await link.close()
    await link.close()
    assert link.status.state is LinkState.CLOSED
    assert (await link.read(("x",)))["x"].quality is Quality.UNAVAILABLE
    await link.open()
    await read_until(link, ("x",), good)
    await link.close()


async def test_many_readers_at_once_get_one_moment_each(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES) as link:
        answers = await asyncio.gather(*(link.read(("x", "y")) for _ in range(10)))
        assert all(a["x"].good and a["x"].time == a["y"].time for a in answers)


BASE = {"host": "cmm", "channels": {"x": {"axis": "X"}}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"channels": {}}, "at least 1 item"),
        ({"channels": {"x": {}}}, "needs one of axis, property, scale_temperature"),
        ({"channels": {"x": {"axis": "X", "property": "A"}}}, "found axis and property"),
        ({"channels": {"x": {"axis": "Q"}}}, "Input should be 'X', 'Y'"),
        ({"channels": {"x": {"axis": "X", "item": 2}}}, "item: only for a property"),
        ({"channels": {"x": {"axis": "X", "scale": 0.0}}}, "scale is 0"),
        ({"channels": {"x": {"property": "A(1), B"}}}, "should match pattern"),
        ({"channels": {"x": {"axis": "X", "typo": 1}}}, "Extra inputs"),
        ({"host": ""}, "at least 1 character"),
        ({"port": 0}, "greater than or equal to 1"),
        ({"move_report": {"time": 0.05, "distance": 1.0}}, "greater than or equal to 0.1"),
        ({"move_report": {"time": 1.0, "distance": 1.0, "within": 0.5}}, "is not more than time"),
        (
            {"move_report": {"time": 1.0, "distance": 1.0}, "channels": PART},
            "no channel has an axis",
        ),
        (
            {
                "move_report": {"time": 1.0, "distance": 1.0},
                "channels": {"x": {"axis": "X", "every": 1.0}},
            },
            "every does not go with move_report",
        ),
    ],
)
def test_configurations_that_cannot_work(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        IppConfig.model_validate(BASE | change)


def test_what_each_channel_is_is_stated() -> None:
    config = IppConfig.model_validate(
        BASE
        | {
            "channels": {
                "x": {"axis": "X", "offset": 1.0},
                "t": {"scale_temperature": "X", "every": 5.0},
                "p": {"property": "Tool.AvrOffsets", "item": 3, "unit": "mm"},
            }
        }
    )
    assert dict(IppLink("cmm", config).channels) == {
        "x": "X by Get, in MachineCsy, × 1 + 1, in mm",
        "t": "temperature of the X scale, every 5 s, in degC",
        "p": "property Tool.AvrOffsets, value 3, every 1 s, in mm",
    }
