"""A real PostgreSQL that answers nothing, as one behind a network that is away."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.daemon.plant_store import MachineRecords, content, store
from tests.support.daemon.postgres import PostgreSQL

pytestmark = [pytest.mark.integration, pytest.mark.xdist_group("postgresql")]


def test_what_waited_goes_up_once_when_it_answers_again(server: PostgreSQL, tmp_path: Path) -> None:
    records = MachineRecords(tmp_path / "mill-7")
    records.run(0)
    records.events(0, 20)
    assert server.process is not None
    ending = threading.Event()
    with store(server, "frozen") as admin:
        up = records.uploader(server.port, "frozen", timeout=1.0)
        thread = threading.Thread(target=up.run, args=(ending,))
        thread.start()
        try:
            wait(lambda: len(content(admin)["events"]) == 20)
            # its connections stay as they are
            frozen = told(server, signal.SIGSTOP)
            try:
                assert len(frozen) > 3
                records.events(20, 500)
                wait(lambda: any("wait for the store" in text for _, text in records.said))
                attempts = up.connections
                wait(lambda: up.connections > attempts + 1)
            finally:
                told(server, signal.SIGCONT)
            assert len(records.said) <= 3
            wait(lambda: len(content(admin)["events"]) == 520)
        finally:
            ending.set()
            thread.join()
        assert sorted(row[1] for row in content(admin)["events"]) == list(range(1, 521))


def told(server: PostgreSQL, what: signal.Signals) -> list[int]:
    """Tell every process of a server; which those are: each is of a session of its own."""
    assert server.process is not None
    mother = server.process.pid
    children = Path(f"/proc/{mother}/task/{mother}/children").read_text()
    processes = [mother, *map(int, children.split())]
    for process in processes:
        os.kill(process, what)
    return processes


def wait(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)
