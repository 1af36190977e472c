"""Errors of an I++ DME server by severity: what becomes of samples, link and server."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from abbe.drivers.link import LinkState, Quality, Sample
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.ipp_links import AXES, PART, REPORT, good, linked, read_until
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

REPORTED = pytest.mark.parametrize("settings", [{}, REPORT], ids=["asked", "reported"])


@pytest.fixture
def cmm() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("ipp", "--seats", "2") as process:
        yield process


def bad(sample: Sample) -> bool:
    return sample.quality is Quality.BAD


@pytest.mark.parametrize(("severity", "number"), [(0, 0), (1, 504)])
async def test_information_and_warnings_leave_the_value_usable_and_are_logged_once(
    cmm: SimulatedProcess, caplog: pytest.LogCaptureFixture, severity: int, number: int
) -> None:
    caplog.set_level("INFO")
    async with linked(cmm, AXES, coordinates="any") as link:
        for _ in range(3):
            cmm.order("error", severity=severity, number=number, text="mind the gap")
            assert (await link.read(("x",)))["x"].good
        assert link.status.state is LinkState.UP
    (said,) = [r for r in caplog.records if "mind the gap" in r.getMessage()]
    assert said.levelname == ("INFO" if severity == 0 else "WARNING")
    assert "ClearAllErrors()" not in cmm.order("report")["commands"]


async def test_a_warning_without_a_value_is_the_reason(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES, coordinates="any") as link:
        cmm.order("error", severity=1, number=504, text="out of range")
        cmm.order("fault", bare=1)
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.BAD
        assert "no X" in sample.reason
        assert "warning 0504 of Get: out of range" in sample.reason


@pytest.mark.parametrize(
    ("severity", "number", "settings"), [(2, 1003, {}), (3, 2500, REPORT)], ids=["2", "3"]
)
async def test_an_error_makes_everything_bad_until_somebody_clears_it(
    cmm: SimulatedProcess,
    caplog: pytest.LogCaptureFixture,
    severity: int,
    number: int,
    settings: dict[str, object],
) -> None:
    async with linked(cmm, AXES | PART, **settings) as link:
        await read_until(link, ("x", "T_part"), good)
        cmm.order("error", severity=severity, number=number, text="Move Out", unasked=True)
        samples = await read_until(link, ("x", "T_part"), bad)
        for sample in samples.values():
            assert f"{number} of Server: Move Out; ClearAllErrors() is needed" in sample.reason
        assert link.status.state is LinkState.DEGRADED
        assert "ClearAllErrors() is needed" in link.status.detail
        asked = len(cmm.order("report")["commands"])

        async def asked_again() -> bool:
            assert bad((await link.read(("x",)))["x"])
            return len(cmm.order("report")["commands"]) > asked

        await until(asked_again)  # now and then, not at every call
        assert "ClearAllErrors()" not in cmm.order("report")["commands"]
        assert link.status.reconnects == 0
        cmm.order("clear")
        await read_until(link, ("x", "T_part"), good)
        assert link.status.state is LinkState.UP
    said = [r.getMessage() for r in caplog.records if r.name == "abbe.drivers.ipp"]
    assert len(said) == 2
    assert "is stopped by" in said[0]
    assert said[1].endswith("the server's errors are cleared")


@REPORTED
async def test_with_clear_errors_the_link_clears_them(
    cmm: SimulatedProcess, settings: dict[str, object]
) -> None:
    async with linked(cmm, AXES, clear_errors=True, **settings) as link:
        for _ in range(2):
            cmm.order("error", severity=3, number=2500, text="Move Out", unasked=True)
            await until(lambda: "Move Out" in link.status.detail)
            await read_until(link, ("x",), good)
    assert "ClearAllErrors()" in cmm.order("report")["commands"]


async def test_a_property_that_the_server_does_not_know_is_asked_twice_and_named(
    cmm: SimulatedProcess,
) -> None:
    channels = AXES | {"foo": {"property": "Part.Foo", "unit": "degC"}}
    async with linked(cmm, channels, clear_errors=True) as link:
        samples = await link.read(("x", "foo"))
        assert bad(samples["foo"])
        assert "GetProp(Part.Foo()) is refused: critical error 0510" in samples["foo"].reason
        await read_until(link, ("x",), good)
        for _ in range(5):
            assert bad((await link.read(("foo",)))["foo"])
        assert link.status.state is LinkState.DEGRADED
        assert "Part.Foo" in link.status.detail

        async def asked(times: int) -> bool:
            await link.read(("x", "foo"))
            commands = cmm.order("report")["commands"]
            return bool(commands.count("GetProp(Part.Foo())") == times)

        await until(lambda: asked(2))
        # then the server is left alone with it, and goes on with the rest
        await read_until(link, ("x",), good)
        await asyncio.sleep(1.5)
        for _ in range(5):
            assert (await link.read(("x",)))["x"].good
        assert await asked(2)


@pytest.mark.parametrize("number", [501, 510, 2500])
async def test_a_brief_refusal_of_positions_leaves_nothing_behind(
    cmm: SimulatedProcess, number: int
) -> None:
    async with linked(cmm, AXES, clear_errors=True) as link:
        await read_until(link, ("x",), good)
        for _ in range(5):
            cmm.order("error", severity=3, number=number, text="Not now")
        await read_until(link, ("x",), bad)
        await read_until(link, ("x",), good)
        assert link.status.reconnects == 0
        assert link.status.state is LinkState.UP


@REPORTED
async def test_a_refusal_that_somebody_clears_leaves_nothing_behind(
    cmm: SimulatedProcess, settings: dict[str, object]
) -> None:
    async with linked(cmm, AXES, coordinates_every=0.0, **settings) as link:
        await read_until(link, ("x",), good)
        cmm.order("error", severity=3, number=510, text="Not now")
        await read_until(link, ("x",), bad)
        cmm.order("clear")
        await read_until(link, ("x",), good)
        assert link.status.reconnects == 0


async def test_a_server_that_does_not_tell_its_coordinates(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES, clear_errors=True) as link:
        cmm.order("error", severity=3, number=501, text="Unsupported command")
        # in which coordinates these are nobody knows
        sample = (await link.read(("x",)))["x"]
        assert "GetCoordSystem() is refused" in sample.reason
        await read_until(link, ("x",), good)


async def test_a_fatal_error_ends_the_connection_and_it_is_found_again(
    cmm: SimulatedProcess,
) -> None:
    async with linked(cmm, AXES, coordinates="any") as link:
        cmm.order("error", severity=9, number=503, text="Controller lost")
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "fatal error 0503 of Get: Controller lost" in sample.reason
        await until(lambda: link.status.state is LinkState.UP)
        cmm.order("error", severity=9, number=2503, text="Scale", unasked=True)
        await until(lambda: link.status.reconnects >= 2)
        await read_until(link, ("x",), good)


async def test_an_axis_that_the_machine_does_not_have_keeps_the_link_down(
    cmm: SimulatedProcess,
) -> None:
    async with linked(cmm, AXES | {"r": {"axis": "R"}}) as link:
        assert link.status.state is LinkState.DOWN
        assert "fatal error 1002 of Get: Axis does not exist" in link.status.detail
