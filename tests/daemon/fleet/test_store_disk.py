"""A real PostgreSQL whose disk is full: nothing is lost, it is said once, and goes on by itself."""

from __future__ import annotations

import contextlib
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.daemon.plant_store import MachineRecords, content, store
from tests.support.daemon.postgres import PostgreSQL

pytestmark = [pytest.mark.integration, pytest.mark.xdist_group("postgresql")]


@pytest.fixture
def disk(server: PostgreSQL) -> Iterator[Path]:
    """A disk of 32 MB, and in it the tablespace ``small`` of the server, for the store "filled"."""
    # not below what belongs to root alone: the server is nobody
    folder = Path(tempfile.mkdtemp(prefix="abbe-disk-"))
    folder.chmod(0o755)
    mount = ["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", str(folder)]
    if os.geteuid() or subprocess.run(mount, check=False, capture_output=True).returncode:
        folder.rmdir()
        pytest.skip("no disk can be mounted here")
    space = folder / "space"
    space.mkdir()
    os.chown(space, server.folder.stat().st_uid, server.folder.stat().st_gid)
    with server.connected() as connection:
        connection.execute(f"CREATE TABLESPACE small LOCATION '{space}'".encode())
    try:
        yield folder
    finally:
        with server.connected() as connection:
            connection.execute("DROP DATABASE IF EXISTS filled WITH (FORCE)")
            connection.execute("DROP TABLESPACE small")
        subprocess.run(["umount", "--lazy", str(folder)], check=False)
        folder.rmdir()


def test_a_disk_that_is_full(server: PostgreSQL, disk: Path, tmp_path: Path) -> None:
    records = MachineRecords(tmp_path / "mill-7")
    records.run(0)
    records.events(0, 20)
    with store(server, "filled", "TABLESPACE small") as admin:
        up = records.uploader(server.port, "filled")
        up.once()
        records.events(20, 2000)
        with contextlib.suppress(OSError), (disk / "filler").open("wb", buffering=0) as filler:
            while True:
                filler.write(bytes(4096))
        ending = threading.Event()
        thread = threading.Thread(target=up.run, args=(ending,))
        thread.start()
        try:
            wait(lambda: any("No space left on device" in text for _, text in records.said))
            attempts = up.connections
            wait(lambda: up.connections > attempts + 3)
            told = [text for _, text in records.said if "No space left" in text]
            assert len(told) <= 5
            assert len(content(admin)["events"]) < 2020
            (disk / "filler").unlink()
            wait(lambda: len(content(admin)["events"]) == 2020)
        finally:
            ending.set()
            thread.join()
        numbers = [row[1] for row in content(admin)["events"]]
        assert sorted(numbers) == list(range(1, 2021))


def wait(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)
