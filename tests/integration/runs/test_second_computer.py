"""Two computers on one controller: two real runs whose locks do not see each other."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from abbe.daemon.status_word import Status
from tests.support.daemon.live_run import (
    PATIENCE,
    Cycle,
    LiveRun,
    compensating,
    live_run,
    machine,
    read_holding,
)
from tests.support.daemon.relay import relay

pytestmark = pytest.mark.integration


@contextmanager
def two_computers(folder: Path, other: str = "") -> Iterator[tuple[int, Path, Path]]:
    """A simulated machine, a configuration for it, and one of another computer; `other` goes into
    the section ``[output]`` of that."""
    with machine(folder) as (simulator, config), relay(simulator.port) as port:
        text = config.read_text()
        assert f"port = {simulator.port}\n" in text
        text = text.replace(f"port = {simulator.port}\n", f"port = {port}\n")
        elsewhere = folder / "elsewhere"
        elsewhere.mkdir()
        second = elsewhere / "config.toml"
        second.write_text(text.replace("[output]\n", f"[output]\n{other}\n", 1))
        yield simulator.port, config, second


def word(port: int) -> int:
    """The status word that the controller holds."""
    return int.from_bytes(read_holding(port, 0, 1))


def hears_another(cycle: Cycle) -> bool:
    return "another computer or program is at work" in cycle["faults"].get("controller", "")


@contextmanager
def started(run: LiveRun) -> Iterator[None]:
    """Wait until it corrects in full: two that come at the same moment would both stand down."""
    run.until(compensating)
    yield


def off(cycle: Cycle) -> bool:
    return set(cycle["guard"]["states"].values()) == {"off"}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_who_comes_second_listens_writes_nothing_and_takes_over(
    tmp_path: Path, how: signal.Signals
) -> None:
    with two_computers(tmp_path) as (port, one, other), live_run(one) as first:
        first.until(compensating)
        since = len(first.cycles)
        with live_run(other) as second:
            heard = second.until(hears_another, 0)
            assert word(port) & Status.COMPENSATING
            second.until(lambda c: c["cycle"] > heard["cycle"] + 100)
            assert not any(c["written"] for c in second.cycles)
            # whoever was there did not notice
            assert all(compensating(c) for c in first.cycles[since:])
            first.process.send_signal(how)
            first.process.wait(PATIENCE)
            second.until(compensating)
            assert word(port) & Status.COMPENSATING
            assert second.end() == 0
    assert "listening for 2 s" in second.journal


@pytest.mark.thorough
def test_who_does_not_listen_is_noticed_and_the_other_stands_down(tmp_path: Path) -> None:
    with two_computers(tmp_path, "read_back = 0") as (port, one, other), live_run(one) as first:
        first.until(compensating)
        with live_run(other) as second:
            second.until(compensating)
            noticed = first.until(lambda c: bool(c["guard"]["status"] & Status.FOREIGN), 0)
            assert hears_another(noticed)
            standing = first.until(off)
            assert not standing["written"]
            assert second.end() == 0
        first.until(compensating)
        assert first.end() == 0
        assert word(port) == 0


def test_who_was_frozen_does_not_write_over_who_took_its_place(tmp_path: Path) -> None:
    with (
        two_computers(tmp_path) as (port, one, other),
        live_run(one) as working,
        started(working),
        live_run(other) as waiting,
    ):
        waiting.until(hears_another, 0)
        frozen = len(working.cycles)
        working.process.send_signal(signal.SIGSTOP)
        try:
            waiting.until(compensating)
        finally:
            working.process.send_signal(signal.SIGCONT)
        working.until(hears_another, frozen)
        since = len(waiting.cycles)
        working.until(off)
        # what was under way when it was frozen may have been taken
        assert not any(c["written"] for c in working.cycles[frozen + 2 :])
        assert all(compensating(c) for c in waiting.cycles[since:])
        assert working.end() == 0
        assert word(port) & Status.COMPENSATING
        assert waiting.end() == 0
        assert word(port) == 0
