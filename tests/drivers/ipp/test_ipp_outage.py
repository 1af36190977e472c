"""Outages of an I++ DME server: dropped, silent, late, in pieces, garbled, taken by another."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Iterator

import pytest

from abbe.drivers.link import LinkState, Quality
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.ipp_links import AXES, IMPATIENT, REPORT, good, linked, read_until
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

REPORTED = pytest.mark.parametrize("settings", [{}, REPORT], ids=["asked", "reported"])


@pytest.fixture
def cmm() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("ipp") as process:
        yield process


@REPORTED
async def test_dropped_and_found_again_with_one_line_in_the_log_each(
    cmm: SimulatedProcess, caplog: pytest.LogCaptureFixture, settings: dict[str, object]
) -> None:
    caplog.set_level(logging.INFO, "abbe")
    async with linked(cmm, AXES, **settings) as link:
        await read_until(link, ("x",), good)
        cmm.order("go")
        # nobody reads meanwhile: the loss itself is noticed
        await until(lambda: link.status.state is LinkState.DOWN)
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "is down" in sample.reason
        await until(lambda: "no connection" in link.status.detail)
        cmm.order("come")
        await until(lambda: link.status.state is LinkState.UP)
        await read_until(link, ("x",), good)
        assert link.status.reconnects == 1
    said = [r.getMessage() for r in caplog.records if r.name == "abbe.drivers.ipp"]
    assert len(said) == 2
    assert " lost: the " in said[0]
    assert " back after " in said[1]


async def test_a_command_in_flight_fails_at_once_when_the_server_goes(
    cmm: SimulatedProcess,
) -> None:
    async with linked(cmm, AXES, timeout=60.0) as link:
        await read_until(link, ("x",), good)
        cmm.order("fault", incomplete=1)
        before = len(cmm.order("report")["commands"])
        call = asyncio.create_task(link.read(("x",)))
        await until(lambda: len(cmm.order("report")["commands"]) > before)
        assert not call.done()
        cmm.order("drop")
        sample = (await asyncio.wait_for(call, 20.0))["x"]
        assert sample.quality is Quality.UNAVAILABLE
    assert link.status.state is LinkState.CLOSED


async def test_a_server_that_appears_after_open_is_found(cmm: SimulatedProcess) -> None:
    cmm.order("go")
    async with linked(cmm, AXES) as link:
        assert link.status.state is LinkState.DOWN
        cmm.order("come")
        await until(lambda: link.status.state is LinkState.UP)


async def test_a_port_that_takes_connections_and_says_nothing_is_down(
    cmm: SimulatedProcess,
) -> None:
    cmm.order("silent", seconds=1000.0)
    async with linked(cmm, AXES, timeout=IMPATIENT) as link:
        assert link.status.state is LinkState.DOWN
        assert "StartSession(): no answer in 0.3 s" in link.status.detail
        cmm.order("silent", seconds=0.0)
        await until(lambda: link.status.state is LinkState.UP)


async def test_a_silent_server_is_lost_and_found(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES, timeout=IMPATIENT) as link:
        await read_until(link, ("x",), good)
        cmm.order("silent", seconds=1000.0)
        await read_until(link, ("x",), lambda s: s.quality is Quality.UNAVAILABLE)

        async def down() -> bool:
            await link.read(("x",))
            return link.status.state is LinkState.DOWN

        await until(down)
        cmm.order("silent", seconds=0.0)
        await read_until(link, ("x",), good)


async def test_reports_that_stay_away_are_missed(cmm: SimulatedProcess) -> None:
    report = {"move_report": {"time": 0.1, "distance": 0.05, "within": 0.5}}
    async with linked(cmm, AXES, **report) as link:
        await read_until(link, ("x",), good)
        cmm.order("fault", mute_reports=True)
        samples = await read_until(link, ("x",), lambda s: s.quality is Quality.UNAVAILABLE)
        assert "no move report for" in samples["x"].reason
        await until(lambda: "no report came in 0.5 s" in link.status.detail)
        cmm.order("fault", mute_reports=False)
        await read_until(link, ("x",), good)


async def test_a_late_answer_costs_its_own_sample_only(cmm: SimulatedProcess) -> None:
    settings = {"timeout": IMPATIENT, "coordinates": "any", "quarantine_after": 100}
    async with linked(cmm, AXES, **settings) as link:
        await read_until(link, ("x",), good)
        cmm.order("fault", late=1, lateness=2.0)
        samples = await read_until(link, ("x",), lambda s: not s.good)
        assert "Get(X(), Y(), Z()): no answer in 0.3 s" in samples["x"].reason
        await read_until(link, ("x",), good)
        assert link.status.reconnects == 0


@REPORTED
async def test_bytes_one_by_one_and_garbage_between_the_answers(
    cmm: SimulatedProcess, settings: dict[str, object]
) -> None:
    garbage = "\x00\xff\r\n#\r\n12345 # X(\r\n77777 # X(1e9)\r\n77777 %\r\n\r\n"
    async with linked(cmm, AXES, **settings) as link:
        cmm.order("fault", split=True)
        for _ in range(5):
            await read_until(link, ("x", "y", "z"), good)
        cmm.order("fault", split=False, garbage=garbage)
        for _ in range(5):
            samples = await read_until(link, ("x", "y", "z"), good)
            assert all(abs(sample.value) < 1000.0 for sample in samples.values())
        cmm.order("say", text=garbage)
        cmm.order("say", text='E0000 # KeyPress("F1")\r\nE0000 # PtMeas(X(1e9), Y(2))\r\n')
        cmm.order("say", text="E0999 # X(1e9), Y(1e9), Z(1e9)\r\n00000 # X(1e9)\r\n")
        samples = await read_until(link, ("x", "y", "z"), good)
        assert all(abs(sample.value) < 1000.0 for sample in samples.values())
        assert link.status.state is LinkState.UP
        assert link.status.reconnects == 0


async def test_an_answer_without_acknowledgement_is_taken_and_one_without_end_is_not(
    cmm: SimulatedProcess,
) -> None:
    settings = {"coordinates": "any", "timeout": IMPATIENT, "quarantine_after": 100}
    async with linked(cmm, AXES, **settings) as link:
        cmm.order("fault", untaken=1)
        await read_until(link, ("x",), good)
        cmm.order("fault", incomplete=1)
        samples = await read_until(link, ("x",), lambda s: not s.good)
        assert "taken and not completed in 0.3 s" in samples["x"].reason
        await read_until(link, ("x",), good)


async def test_broken_reports_make_positions_bad(cmm: SimulatedProcess) -> None:
    report = {"move_report": {"time": 0.1, "distance": 0.05, "within": 1000.0}}
    async with linked(cmm, AXES, **report) as link:
        await read_until(link, ("x",), good)
        cmm.order("fault", mute_reports=True)
        cmm.order("say", text="E0001 # X(1), Y(\r\n")
        samples = await read_until(link, ("x", "z"), lambda s: s.quality is Quality.BAD)
        assert "report: " in samples["x"].reason
        cmm.order("say", text="E0001 # X(1), Y(NULL)\r\n")
        await read_until(link, ("x",), lambda s: s.good and s.value == 1.0)
        samples = await link.read(("y", "z"))
        assert "no value for Y (NULL)" in samples["y"].reason
        assert "no Z; it has X, Y" in samples["z"].reason


async def test_a_server_that_another_client_holds(cmm: SimulatedProcess) -> None:
    """Most servers take one client: the link waits, and is there when the seat is free."""
    where = (cmm.ready["host"], cmm.ready["port"])
    with socket.create_connection(where, timeout=20.0) as other:
        other.sendall(b"00001 StartSession()\r\n")
        assert other.recv(100).startswith(b"00001 &\r\n")
        async with linked(cmm, AXES) as link:
            assert link.status.state is LinkState.DOWN
            assert cmm.order("report")["turned_away"] >= 1
            other.close()
            await until(lambda: link.status.state is LinkState.UP)
            await read_until(link, ("x",), good)


async def test_two_links_at_a_server_that_takes_two() -> None:
    with SimulatedProcess("ipp", "--seats", "2") as cmm:
        async with linked(cmm, AXES) as one, linked(cmm, AXES, **REPORT) as two:
            await read_until(one, ("x",), good)
            await read_until(two, ("x",), good)
            await one.close()
            await read_until(two, ("x",), good)


async def test_a_cancelled_read_leaves_nothing_behind(cmm: SimulatedProcess) -> None:
    async with linked(cmm, AXES, coordinates="any") as link:
        await read_until(link, ("x",), good)
        cmm.order("fault", late=1, lateness=30.0)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(link.read(("x",)), 0.05)
        await read_until(link, ("x", "y"), good)
        assert link.status.state is LinkState.UP
