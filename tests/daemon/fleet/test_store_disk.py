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

import psycopg
import pytest

from tests.support.daemon.plant_store import MachineRecords, content, store
from tests.support.daemon.postgres import PostgreSQL

pytestmark = [pytest.mark.integration, pytest.mark.xdist_group("postgresql")]


@pytest.fixture
def mounted(request: pytest.FixtureRequest) -> Iterator[Path]:
    """A disk of so many MB as the test asks for."""
    # not below what belongs to root alone: the server is nobody
    folder = Path(tempfile.mkdtemp(prefix="abbe-disk-"))
    folder.chmod(0o755)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={request.param}m", "tmpfs", str(folder)]
    if os.geteuid() or subprocess.run(mount, check=False, capture_output=True).returncode:
        folder.rmdir()
        pytest.skip("no disk can be mounted here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=False)
        folder.rmdir()


@pytest.fixture
def disk(server: PostgreSQL, mounted: Path) -> Iterator[Path]:
    """A disk with the tablespace ``small`` of the server in it, for the store "filled"."""
    folder = mounted
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


@pytest.mark.parametrize("mounted", [32], indirect=True)
def test_a_disk_that_is_full(server: PostgreSQL, disk: Path, tmp_path: Path) -> None:
    records = MachineRecords(tmp_path / "mill-7")
    records.run(0)
    records.events(0, 20)
    with store(server, "filled", "TABLESPACE small") as admin:
        up = records.uploader(server.port, "filled")
        up.once()
        records.events(20, 2000)
        fill(disk)
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


@pytest.mark.thorough
@pytest.mark.parametrize("mounted", [160], indirect=True)
def test_no_room_for_the_log_ends_the_server(mounted: Path, tmp_path: Path) -> None:
    """PostgreSQL gives up when its write-ahead log cannot grow; begun again, it is filled up."""
    records = MachineRecords(tmp_path / "mill-7")
    records.run(0)
    records.events(0, 20)
    ending = threading.Event()
    server = PostgreSQL(mounted)
    try:
        server.begin()
        with store(server, "filled") as admin:
            up = records.uploader(server.port, "filled")
            up.once()
            records.events(20, 2000)
            fill(mounted)
            grow = "SELECT pg_switch_wal(), pg_logical_emit_message(true, 'a', 'b')"
            growing = "FOR i IN 1..5 LOOP PERFORM FROM (" + grow + ") AS each; END LOOP"
            with pytest.raises(psycopg.Error, match="No space left"):
                admin.execute(f"DO $$ BEGIN {growing}; END $$".encode())
        thread = threading.Thread(target=up.run, args=(ending,))
        thread.start()
        try:
            assert server.process is not None
            assert server.process.wait(60) == 1
            attempts = up.connections
            wait(lambda: up.connections > attempts + 3)
            assert len(records.said) <= 5
            (mounted / "filler").unlink()
            server.kill()
            server.begin()
            with server.connected(database="filled") as admin:
                wait(lambda: len(content(admin)["events"]) == 2020)
                numbers = [row[1] for row in content(admin)["events"]]
            assert sorted(numbers) == list(range(1, 2021))
        finally:
            ending.set()
            thread.join()
    finally:
        server.kill()


def fill(disk: Path) -> None:
    """Leave no room on a disk; the file ``filler`` in it takes it."""
    with contextlib.suppress(OSError), (disk / "filler").open("wb", buffering=0) as filler:
        while True:
            filler.write(bytes(4096))


def wait(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)
