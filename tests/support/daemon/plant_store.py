"""A store, a machine's own records, and a wire between them that can be cut."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psycopg

from abbe.daemon.fleet.store.migrating import migrate
from abbe.daemon.fleet.store.roles import add_machine
from abbe.daemon.fleet.uploading.uploader import Uploader
from abbe.daemon.records import writer as records_writer
from abbe.daemon.records.schema import open_to_write
from abbe.daemon.records.writer import EventRow, RunRow
from tests.support.daemon.postgres import PostgreSQL

MODEL = """format = "abbe-model/1"
[machine]
name = "Mill 7"
structure = "w X' b Y Z t"
reference_temperature = 20.0
[machine.axes.X]
travel = [0.0, 800.0]
[machine.axes.Y]
travel = [0.0, 500.0]
[machine.axes.Z]
travel = [0.0, 500.0]
"""
CAMPAIGN = """# format = "abbe-campaign/1"
# machine = "Mill 7"
time,setup,kind,X,Y,Z,ux,uy,uz,value
0.0,a,displacement,0,0,0,1,0,0,0.0
1.0,a,displacement,400,0,0,1,0,0,4.0
2.0,a,displacement,800,0,0,1,0,0,8.0
"""
CHECKS = """# format = "abbe-campaign/1"
# machine = "Mill 7"
time,setup,kind,X,Y,Z,ux,uy,uz,value
1790000000.0,ball,displacement,400,0,0,1,0,0,4.0
1790000000.0,ball,displacement,400,0,0,1,0,0,4.0
1790003600.0,ball,displacement,400,0,0,1,0,0,4.5
"""
BEGIN = 1_790_000_040
"""A whole minute, s since 1970."""
TABLES = ("machines", "models", "campaigns", "runs", "checks", "series", "history", "events")


class MachineRecords:
    """A machine's folder: records, model, campaigns, checks; written as a run writes them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "records.sqlite"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "machine.toml").write_text(MODEL, "utf-8")
        (folder / "campaigns").mkdir(exist_ok=True)
        campaign = folder / "campaigns" / "x.csv"
        campaign.write_text(CAMPAIGN, "utf-8")
        settle(campaign)
        (folder / "checks.csv").write_text(CHECKS, "utf-8")

    def write(self, *items: Any) -> None:
        """Commit some records together, as the run's thread does."""
        with contextlib.closing(open_to_write(self.file)) as connection, connection:
            connection.execute("BEGIN IMMEDIATE")
            scribe = _Scribe()
            for item in items:
                scribe._one(connection, item)
            records_writer._touch(connection, items)

    def values(self, *values: tuple[str, str, float, float]) -> None:
        """Commit values: series, unit, time, value."""
        self.write(list(values))

    def minutes(self, first: int, count: int, of: Callable[[int], float] = float) -> None:
        """Three values a minute of two series, from a minute on."""
        for minute in range(first, first + count):
            at = BEGIN + 60 * minute
            self.write(
                *(
                    [
                        ("T_x", "degC", at + s, 20.0 + of(minute) + s / 60.0),
                        ("correction_X", "mm", at + s, 1e-3 * of(minute)),
                    ]
                    for s in (0.5, 20.5, 40.5)
                )
            )

    def events(self, first: int, count: int) -> None:
        self.write(
            *(
                EventRow(
                    BEGIN + 7.0 * i, "ERROR" if i % 5 == 4 else "INFO", "abbe.test", f"no. {i}"
                )
                for i in range(first, first + count)
            )
        )

    def run(self, number: int) -> None:
        at = BEGIN + 3600.0 * number
        self.write(RunRow(at, "0.1", "c.toml", "c" * 64, "m.toml", "e" * 64, "Mill 7"))

    def task(self, port: int, database: str, **more: Any) -> dict[str, Any]:
        """As a run hands it to its process."""
        return {
            "host": "127.0.0.1", "port": port, "database": database, "tls": False,
            "site": "Plant 2", "machine": "Mill 7", "user": "mill_7", "every": 0.05, "span": 60,
            "campaigns": ["campaigns/*.csv"], "models": [], "timeout": 5.0,
            "reconnect_min": 0.01, "reconnect_max": 0.05, "folder": str(self.folder),
            "model": "machine.toml", "structure": "w X' b Y Z t", "records": str(self.file),
            "checks": str(self.folder / "checks.csv"),
        } | more  # fmt: skip

    def uploader(
        self, port: int, database: str, *, now: float = BEGIN + 1e6, **more: Any
    ) -> Uploader:
        """One that keeps what it says in `said`."""
        self.said: list[tuple[int, str]] = []
        say = lambda level, text: self.said.append((level, text))  # noqa: E731
        return Uploader(self.task(port, database, **more), say, lambda: now)


class _Scribe(records_writer.RecordWriter):
    """The run's writer without its thread."""

    def __init__(self) -> None:
        self._series = {}


def settle(path: Path) -> None:
    """Make a file look as if it had been left alone for long."""
    import os

    then = time.time() - 1000.0
    os.utime(path, (then, then))


@contextmanager
def store(server: PostgreSQL, name: str, where: str = "") -> Iterator[psycopg.Connection[Any]]:
    """A new store with Mill 7 in it, whose writer is mill_7; as an administrator."""
    with server.connected() as connection:
        connection.execute(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)".encode())
        connection.execute(f"CREATE DATABASE {name} {where}".encode())
    with server.connected(database=name) as connection:
        migrate(connection)
        add_machine(connection, "Mill 7", "Plant 2", "VMC 850", "mill_7", "")
        yield connection


def emptied(connection: psycopg.Connection[Any]) -> None:
    """The store as it was before anything was uploaded."""
    # some rows: quicker than to truncate
    tables = ["models", "campaigns", "runs", "checks", "series", "history", "events", "uploads"]
    forgotten = [f"DELETE FROM abbe.{table}" for table in tables]
    forgotten.append("UPDATE abbe.machines SET seen = NULL, status = NULL, model = ''")
    connection.execute("; ".join(forgotten).encode())


def content(connection: psycopg.Connection[Any]) -> dict[str, list[tuple[Any, ...]]]:
    """All that was uploaded, without when it came."""
    found = {}
    for table in TABLES:
        cursor = connection.execute(f"SELECT * FROM abbe.{table}".encode())
        names = [c.name for c in cursor.description or ()]
        kept = [i for i, n in enumerate(names) if n not in ("stored", "seen", "added", "status")]
        found[table] = sorted((tuple(row[i] for i in kept) for row in cursor), key=repr)
    return found


class CuttingWire:
    """Carries a client of PostgreSQL's to its server, message by message, until it is cut.

    Parameters
    ----------
    port
        Of the server.
    cut_after
        Messages of the client's that reach the server; 0: all. The answer to the last one does not
        come through: whether it was carried out the client cannot know.

    Attributes
    ----------
    kinds
        Of the client's messages so far, a letter each: ``Q`` a statement, ``S`` the end of one that
        was sent in parts, or of several.
    """

    def __init__(self, port: int, cut_after: int = 0) -> None:
        self._to, self._cut_after = port, cut_after
        self.kinds = ""
        self._threads: list[threading.Thread] = []

    @contextmanager
    def standing(self) -> Iterator[int]:
        """Its port."""
        with socket.create_server(("127.0.0.1", 0)) as listener:
            thread = threading.Thread(target=self._accept, args=(listener,))
            thread.start()
            try:
                yield listener.getsockname()[1]
            finally:
                listener.shutdown(socket.SHUT_RDWR)
                thread.join()
                for carrying in self._threads:
                    carrying.join()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                carrying = threading.Thread(target=self._carry, args=(client,))
                self._threads.append(carrying)
                carrying.start()

    def _carry(self, client: socket.socket) -> None:
        server = socket.create_connection(("127.0.0.1", self._to))
        for end in (client, server):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        deaf = threading.Event()
        back = threading.Thread(target=self._carry_back, args=(server, client, deaf))
        back.start()
        with contextlib.suppress(OSError, EOFError):
            self._forward(client, server, b"")
            while True:
                self._forward(client, server, _exactly(client, 1), deaf)
        with contextlib.suppress(OSError):
            # what the server has got it works off, and it says so to nobody
            server.shutdown(socket.SHUT_WR)
        back.join()
        client.close()
        server.close()

    def _forward(
        self, client: socket.socket, server: socket.socket, kind: bytes,
        deaf: threading.Event | None = None,
    ) -> None:  # fmt: skip
        length = _exactly(client, 4)
        body = _exactly(client, struct.unpack("!I", length)[0] - 4)
        self.kinds += kind.decode("ascii") or "-"
        last = self._cut_after and len(self.kinds) >= self._cut_after
        if last and deaf is not None:
            deaf.set()
        server.sendall(kind + length + body)
        if last:
            raise EOFError

    def _carry_back(
        self, server: socket.socket, client: socket.socket, deaf: threading.Event
    ) -> None:
        with contextlib.suppress(OSError):
            while data := server.recv(65536):
                if not deaf.is_set():
                    client.sendall(data)
            client.shutdown(socket.SHUT_RDWR)


def _exactly(end: socket.socket, count: int) -> bytes:
    found = b""
    while len(found) < count:
        data = end.recv(count - len(found))
        if not data:
            raise EOFError
        found += data
    return found


def same(first: dict[str, Sequence[Any]], second: dict[str, Sequence[Any]]) -> bool:
    """Whether two stores hold the same; says where they do not."""
    for table, rows in first.items():
        assert list(rows) == list(second[table]), table
    return True
