"""The end of a run: the controller is told, or the exit status and a line say that it was not."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.daemon.status_word import Status
from tests.support.daemon.live_run import (
    LiveRun,
    compensating,
    live_run,
    machine,
    matched,
    read_holding,
)
from tests.support.daemon.refusing_gateway import Refuses, RefusingGateway

pytestmark = pytest.mark.integration

FULL = 0x7003
"""Status word: running, corrected in full in X, Y and Z."""


def last_line(run: LiveRun) -> str:
    """The line that says why the exit status is not 0; nothing else follows it."""
    assert "Traceback" not in run.journal
    line = run.journal.splitlines()[-1]
    assert line.startswith("abbe: the controller could not be told that Abbe has ended: ")
    return line


def numbers(line: str) -> dict[str, float]:
    """Axis → corrected position that the controller was last known to hold, mm.

    Perhaps: a message was under way when the machine went.
    """
    return {
        m[1]: float(m[2])
        for m in re.finditer(r"\b([XYZ]) (-?[\d.e+-]+) mm (?:perhaps )?since", line)
    }


def refuse(run: LiveRun, gateway: RefusingGateway, what: Refuses) -> None:
    """Have the gateway refuse once the machine is compensated in full, and the run notice it."""
    run.until(compensating)
    gateway.refuses = what
    run.until(lambda c: not c["written"])


def test_a_machine_that_is_gone_at_the_end(tmp_path: Path) -> None:
    stand = ("--stand-at", "650,800,-60")
    with machine(tmp_path, *stand) as (simulator, config), live_run(config) as run:
        run.until(lambda c: compensating(c) and c["indicated"]["X"] == 650.0)
        run.until(compensating)
        held = matched(simulator.port)
        simulator.process.send_signal(signal.SIGKILL)
        run.until(lambda c: c["links"]["cmm"]["state"] != "up")
        assert run.end() == 1
        line = last_line(run)
        assert "link cmm is" in line
        assert "status word 0x" in line
        for axis, value in numbers(line).items():
            # the machine stands; what drifts on are its temperatures
            assert value == pytest.approx(held[f"corrected_{axis}"], abs=5e-4)
        assert set(numbers(line)) == set("XYZ")


def test_a_machine_that_was_never_there_is_no_failure_at_the_end(tmp_path: Path) -> None:
    with machine(tmp_path) as (_, config):
        pass
    with live_run(config) as run:
        run.until(lambda c: c["time"] > 1.0)
        assert run.end() == 0


@pytest.fixture
def gateway(tmp_path: Path) -> Iterator[tuple[RefusingGateway, int, Path]]:
    """A gateway that refuses at will, the machine's own port, a configuration for the gateway."""
    with machine(tmp_path) as (simulator, config):
        between = RefusingGateway(simulator.port)
        text = config.read_text()
        assert f"port = {simulator.port}" in text
        config.write_text(text.replace(f"port = {simulator.port}", f"port = {between.port}"))
        try:
            yield between, simulator.port, config
        finally:
            between.close()


@pytest.mark.thorough
def test_a_controller_that_refuses_blocks_gets_the_word_by_itself(
    gateway: tuple[RefusingGateway, int, Path],
) -> None:
    between, port, config = gateway
    with live_run(config) as run:
        refuse(run, between, "blocks")
        assert read_holding(port, 0, 1) != b"\0\0"
        assert run.end() == 0
        assert read_holding(port, 0, 1) == b"\0\0"


def test_a_controller_that_refuses_everything_is_named_with_what_it_holds(
    gateway: tuple[RefusingGateway, int, Path],
) -> None:
    between, port, config = gateway
    with live_run(config) as run:
        refuse(run, between, "all")
        assert run.end() == 1
        word, held = int.from_bytes(read_holding(port, 0, 1)), matched(port)
        line = last_line(run)
        assert word & Status.RUNNING
        assert f"status word {word:#06x} (RUNNING" in line
        assert numbers(line) == pytest.approx(
            {axis: held[f"corrected_{axis}"] for axis in "XYZ"}, abs=5.1e-6
        )


@pytest.mark.thorough
def test_one_that_takes_it_late_gets_the_word_all_the_same(
    gateway: tuple[RefusingGateway, int, Path],
) -> None:
    between, port, config = gateway
    with live_run(config) as run:
        refuse(run, between, "all")
        between.relents_after = 3
        assert run.end() == 0
        assert between.relents_after == 0
        assert read_holding(port, 0, 1) == b"\0\0"
