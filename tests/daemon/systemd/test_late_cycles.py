"""Cycles that do not come: the journal tells a computer that is too busy from one that hangs."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.systemd.late_cycles import LateCycles

RECORD: CycleRecord = None  # type: ignore[assignment]  # nothing of it is looked at
PATIENCE = 120.0


@pytest.mark.parametrize(
    ("silence", "waited", "said"),
    [
        (4.2, 3.6, "the computer gave Abbe no processor for 3.6 s: no cycle came for 4.2 s"),
        (4.2, 1.0, ""),  # it had one: something else was slow, which has words of its own
        (0.5, 0.5, ""),
    ],
)
def test_a_late_cycle(
    silence: float, waited: float, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    now, wait = 100.0, 7.0
    late = LateCycles(0.02, clock=lambda: now, wait=lambda: wait)
    late(RECORD)
    now, wait = now + silence, wait + waited
    late(RECORD)
    assert caplog.messages == ([said] if said else [])
    now, wait = now + silence, wait + waited
    late(RECORD)
    assert len(caplog.messages) <= 1, "once a minute is enough"


@pytest.mark.parametrize(
    ("waited", "begins", "level"),
    [
        (1e6, "the computer gives Abbe no processor: ", logging.WARNING),
        (0.0, "the cycle hangs since ", logging.ERROR),
    ],
)
def test_a_cycle_that_does_not_come_is_said_before_the_watchdog_ends_it(
    waited: float, begins: str, level: int, caplog: pytest.LogCaptureFixture
) -> None:
    wait = 0.0
    late = LateCycles(0.02, watchdog=2.5, wait=lambda: wait)
    with late.running():
        late(RECORD)
        wait = waited
        deadline = time.monotonic() + PATIENCE
        while not caplog.messages:
            assert time.monotonic() < deadline
            time.sleep(0.02)
    assert caplog.messages[0].startswith(begins)
    assert caplog.records[0].levelno == level
    assert len(caplog.messages) == 1
    assert "late cycles" not in [thread.name for thread in threading.enumerate()]


_CYCLES = """
import logging, sys, time
from abbe.daemon.systemd import late_cycles
late_cycles._LATE, late_cycles._AGAIN = 0.3, 0.0
logging.basicConfig(stream=sys.stdout, format="%(message)s")
late = late_cycles.LateCycles(0.01, watchdog=float(sys.argv[1]))
with late.running():
    late(None)
    print("ready", flush=True)
    for _ in range(100_000):
        time.sleep(0.01)
        late(None)
        sys.stdout.flush()
"""
_HOG = "while True: pass"


@contextmanager
def child(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate(timeout=PATIENCE)


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_a_process_that_gets_no_processor_says_so() -> None:
    """On one processor with two that never rest, behind which it steps back."""
    here = {min(os.sched_getaffinity(0))}
    with child(_CYCLES, "0") as process, child(_HOG) as one, child(_HOG) as other:
        assert line(process) == "ready"
        for busy in (one, other, process):
            os.sched_setaffinity(busy.pid, here)
        os.sched_setscheduler(process.pid, os.SCHED_IDLE, os.sched_param(0))
        assert line(process).startswith("the computer gave Abbe no processor for ")


def test_a_process_that_was_stopped_does_not_blame_the_processor() -> None:
    with child(_CYCLES, "0") as process:
        assert line(process) == "ready"
        process.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        process.send_signal(signal.SIGCONT)
        time.sleep(0.5)
        process.kill()
        said = process.communicate(timeout=PATIENCE)[0].splitlines()
    # a busy computer may hold it up besides; the second in which it was stopped is not in that
    assert not [s for s in said if float(s.split(" for ")[1].split()[0]) > 0.9]


def test_what_the_watchdog_ends_leaves_where_it_was() -> None:
    with child(_CYCLES, "60") as process:
        assert line(process) == "ready"
        process.send_signal(signal.SIGABRT)
        told = process.communicate(timeout=PATIENCE)[1]
    assert process.returncode == -signal.SIGABRT
    assert "most recent call first" in told
    assert "in _watch" in told
