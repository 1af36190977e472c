"""The thread that writes records: whatever the disk does, the cycle never waits for it.

Items are handed over by a bounded queue. A disk that is full or read-only is said once, tried again
every few seconds, and what came meanwhile is counted as lost; a file that is damaged is put aside
and a new one begun. Which model runs is never lost: every file knows it.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import sqlite3
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from abbe.daemon.records.schema import NotRecordsError, open_to_write
from abbe.daemon.records.thinning import Retention, thin
from abbe.daemon.records.whole_file import WholeFileLooks

logger = logging.getLogger("abbe.records")

COMMIT_EVERY = 0.5
"""s from one commit to the next: what a crash can lose."""
_AGAIN = 5.0
"""s from one attempt to write to the next."""
_THIN_EVERY = 900.0
"""s from one look at what has grown old to the next."""
_WAITING = 20_000
"""Items that may wait; about ten minutes of a slow disk."""
_OWED = 1000
"""Beginnings of runs that wait at most for a disk that can be written."""
_END = 5.0
"""s that the last items are given at the end."""

Value = tuple[str, str, float, float]
"""Series, unit, time (s since 1970), value."""


@dataclass(frozen=True, slots=True)
class RunRow:
    """The beginning of a run, or of a reloaded model within one."""

    began: float
    abbe: str
    configuration: str
    configuration_sha256: str
    model: str
    model_sha256: str
    machine: str


@dataclass(frozen=True, slots=True)
class EventRow:
    """One event of the journal."""

    time: float
    level: str
    part: str
    message: str


_Item = Sequence[Value] | RunRow | EventRow


class RecordWriter:
    """Writes records in a thread of its own.

    Parameters
    ----------
    path
        The database; made where there is none.
    retention
        How long what is kept.
    """

    def __init__(self, path: Path, retention: Retention) -> None:
        self._path = path
        self._retention = retention
        self._queue: queue.Queue[_Item] = queue.Queue(_WAITING)
        self._end = threading.Event()
        self._lost = 0
        self._problem = ""
        self._series: dict[str, int] = {}
        self._latest: RunRow | None = None
        self._owed: list[RunRow] = []
        self._inode = 0
        self._connection: sqlite3.Connection | None = None
        self._thin_at = time.monotonic() + _THIN_EVERY / 10
        self._looks = WholeFileLooks(path)
        self._thread = threading.Thread(target=self._run, name="records", daemon=True)
        self._thread.start()

    def put(self, item: _Item) -> None:
        """Hand something over; never waits. What finds no room is counted as lost."""
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self._lost += 1

    def close(self) -> None:
        """Write what waits, and end."""
        self._end.set()
        self._thread.join(_END)

    def _run(self) -> None:
        retry_at = -float("inf")
        while True:
            ending = self._end.wait(COMMIT_EVERY)
            if time.monotonic() >= retry_at or ending:
                items: list[_Item] = []
                try:
                    self._notice_damage()
                    items = self._waiting()
                    self._write(items)
                except sqlite3.Error as error:
                    self._lost += len(items)
                    self._failed(error)
                    retry_at = time.monotonic() + _AGAIN
            if ending:
                self._looks.close()
                self._close()
                return

    def _waiting(self) -> list[_Item]:
        """What has come; beginnings of runs are kept apart until they are written."""
        items: list[_Item] = []
        for _ in range(self._queue.qsize()):
            item = self._queue.get_nowait()
            if isinstance(item, RunRow):
                self._owed = [*self._owed, item][-_OWED:]
                self._latest = item
            else:
                items.append(item)
        return items

    def _write(self, items: Sequence[_Item]) -> None:
        self._notice_loss()
        if not items and not self._owed and self._connection is not None:
            self._thin()
            return
        if self._connection is None:
            self._connection = open_to_write(self._path)
            self._inode = _inode(self._path)
            self._series = dict(
                self._connection.execute("SELECT name, series FROM series").fetchall()
            )
        with self._connection as connection:
            connection.execute("BEGIN IMMEDIATE")
            for item in (*self._owed, *items):
                self._one(connection, item)
            _touch(connection, items)
        self._owed = []
        if self._problem:
            self._problem = ""
            logger.warning("records are written again; %d are missing", self._lost)
            self._lost = 0
        self._thin()

    def _one(self, connection: sqlite3.Connection, item: _Item) -> None:
        if isinstance(item, RunRow):
            # what is written again after a loss may be there all the same
            connection.execute(
                "INSERT INTO runs (began, abbe, configuration, configuration_sha256, model, "
                "model_sha256, machine) SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7 WHERE NOT EXISTS "
                "(SELECT 1 FROM runs WHERE began = ?1 AND model_sha256 = ?6 "
                "AND configuration_sha256 = ?4)",
                (
                    item.began,
                    item.abbe,
                    item.configuration,
                    item.configuration_sha256,
                    item.model,
                    item.model_sha256,
                    item.machine,
                ),
            )
        elif isinstance(item, EventRow):
            connection.execute(
                "INSERT INTO events (time, level, part, message) VALUES (?, ?, ?, ?)",
                (item.time, item.level, item.part, item.message),
            )
        else:
            rows = [(self._number(connection, n, unit), at, value) for n, unit, at, value in item]
            connection.executemany("INSERT OR REPLACE INTO full VALUES (?, ?, ?)", rows)

    def _number(self, connection: sqlite3.Connection, name: str, unit: str) -> int:
        found = self._series.get(name)
        if found is None:
            made = connection.execute(
                "INSERT INTO series (name, unit) VALUES (?, ?) "
                "ON CONFLICT (name) DO UPDATE SET unit = excluded.unit RETURNING series",
                (name, unit),
            )
            ((found,),) = made.fetchall()
            self._series[name] = found
        return found

    def _thin(self) -> None:
        now = time.monotonic()
        if self._connection is not None and now >= self._thin_at:
            self._thin_at = now + _THIN_EVERY
            thin(self._connection, self._retention, time.time(), self._path)

    def _failed(self, error: sqlite3.Error) -> None:
        # what was numbered in a transaction that failed was not
        self._series = {}
        self._close()
        damaged = not isinstance(error, sqlite3.OperationalError | NotRecordsError)
        if damaged and isinstance(error, sqlite3.DatabaseError):
            self._put_aside(error)
            return
        if not self._problem:
            logger.error("records cannot be written: %s (%s)", error, self._path)
        self._problem = str(error) or type(error).__name__

    def _notice_loss(self) -> None:
        """A file that somebody took away would be written on, and be lost with its last reader."""
        if self._connection is None or _inode(self._path) == self._inode:
            return
        self._series = {}
        self._close()
        self._begin_anew()
        logger.warning("the records were taken away (%s): begun anew", self._path)

    def _notice_damage(self) -> None:
        """A page that is not written any more would be found damaged by who needs it."""
        if damage := self._looks.damage(self._inode):
            raise sqlite3.DatabaseError(damage)

    def _begin_anew(self) -> None:
        """The next file is a new one: it has to know what runs."""
        if self._latest is not None and self._latest not in self._owed:
            self._owed.insert(0, self._latest)

    def _put_aside(self, error: sqlite3.Error) -> None:
        """A damaged file keeps what can be rescued from it, under another name."""
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
        aside = self._path.with_name(f"{self._path.name}.damaged-{stamp}")
        try:
            self._path.rename(aside)
            for end in ("-wal", "-shm"):
                beside = self._path.with_name(self._path.name + end)
                with contextlib.suppress(FileNotFoundError):
                    beside.rename(aside.with_name(aside.name + end))
        except OSError as failure:
            if not self._problem:
                logger.error(
                    "the records are damaged (%s) and cannot be put aside: %s (%s)",
                    error,
                    failure.strerror,
                    self._path,
                )
            self._problem = str(error)
            return
        self._begin_anew()
        logger.error("the records were damaged (%s): put aside as %s, begun anew", error, aside)

    def _close(self) -> None:
        if self._connection is not None:
            with contextlib.suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None


def _touch(connection: sqlite3.Connection, items: Sequence[_Item]) -> None:
    """Note which minutes were written to, by a number that grows, whatever the clock does."""
    minutes = {
        int(at // 60.0) * 60
        for item in items
        if not isinstance(item, RunRow | EventRow)
        for _, _, at, _ in item
    }
    for minute in sorted(minutes):
        connection.execute(
            "INSERT INTO touched SELECT ?, coalesce(max(mark), 0) + 1 FROM touched WHERE true "
            "ON CONFLICT (minute) DO UPDATE SET mark = excluded.mark",
            (minute,),
        )


def _inode(path: Path) -> int:
    """Which file it is; 0: there is none."""
    try:
        return path.stat().st_ino
    except OSError:
        return 0
