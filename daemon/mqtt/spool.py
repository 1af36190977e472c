"""What the broker has not taken yet: on disk, bounded, in order; in memory if the disk is full."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import sqlite3
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from abbe.daemon.mqtt.messages import Message

_IN_MEMORY = 2000
"""Messages kept in memory while the disk takes none."""
_AT_ONCE = 100
"""Messages that are given up at a time when there are too many."""
_LONGEST = 256_000
"""Bytes of one message; a status has some thousands."""
_AGAIN = 5.0
"""s from one attempt to use the disk to the next."""
_OURS = 0x41626D71
"""SQLite's application_id of such files."""
_HEAD = b"SQLite format 3\x00"
_SCHEMA = """
CREATE TABLE IF NOT EXISTS waiting (
  number INTEGER PRIMARY KEY AUTOINCREMENT, series TEXT NOT NULL, id INTEGER NOT NULL,
  topic TEXT NOT NULL, retain INTEGER NOT NULL, body BLOB NOT NULL, UNIQUE (series, id))
"""


class Waiting(NamedTuple):
    """One message that waits.

    Attributes
    ----------
    series, id
        Which one it is, for ever: ids of a series count from 1 without a gap.
    topic
        Its last level.
    retain
        As `Message` has it.
    body
        JSON.
    """

    series: str
    id: int
    topic: str
    retain: bool
    body: bytes

    @property
    def key(self) -> tuple[str, int]:
        """Which one it is."""
        return self.series, self.id


class Spool:
    """Messages in the order in which they came, until the broker has taken them.

    Parameters
    ----------
    path
        SQLite file; one that is damaged is put aside, one of somebody else's is left alone.
    max_bytes
        Of all messages; beyond it the oldest go.
    say
        Takes a sentence for the journal.

    Attributes
    ----------
    last_id
        Of the message that was taken last.
    lost
        Messages that were given up.
    """

    def __init__(self, path: Path, max_bytes: int, say: Callable[[str], None]) -> None:
        self._path, self._max_bytes, self._say = path, max_bytes, say
        self._db: sqlite3.Connection | None = None
        self._again = 0.0
        self._bytes = 0
        self._memory: deque[Waiting] = deque()
        self._sent: set[tuple[str, int]] = set()
        self._connections = 0
        self.last_id = 0
        self.series = f"{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}-{os.urandom(4).hex()}"
        self.lost = 0
        self._said = ""

    def add(self, message: Message) -> Waiting | None:
        """Take a message; None: it is longer than any may be, and lost."""
        number = self.last_id = self.last_id + 1
        body = {"series": self.series, "id": number, **message.body}
        # ASCII: no text of anybody's makes it anything but JSON
        data = json.dumps(body, allow_nan=False).encode("ascii")
        made = Waiting(self.series, number, message.topic, message.retain, data)
        if len(data) > _LONGEST:
            self._lose(1, f"a message of {len(data)} bytes is not published")
            return None
        self._memory.append(made)
        self._to_disk()
        while len(self._memory) > _IN_MEMORY:
            self._memory.popleft()
            self._lose(1, "the disk takes nothing, and too much waits for the broker")
        return made

    def next_connection(self) -> int:
        """The number of the next connection, from 0, over restarts where the disk takes it."""
        db = self._opened()
        number = self._connections
        if db is not None:
            try:
                (kept,) = db.execute("PRAGMA user_version").fetchone()
                number = max(number, kept)
                db.execute(f"PRAGMA user_version = {(number + 1) % (1 << 30)}")
            except sqlite3.Error as error:
                self._failed(error)
        self._connections = number + 1
        return number

    def oldest(self, count: int) -> list[Waiting]:
        """The first that wait, in order."""
        return [*self._on_disk(count), *itertools.islice(self._memory, count)][:count]

    def done(self, message: Waiting) -> None:
        """Forget a message: the broker has it."""
        self._memory = deque(held for held in self._memory if held.key != message.key)
        self._sent.add(message.key)
        self._forget()

    def close(self) -> None:
        """Write what can be written, and end."""
        self._again = 0.0
        self._to_disk()
        self._forget()
        self._give_up_disk()

    def _to_disk(self) -> None:
        """Move what is in memory to the disk, as far as it takes it."""
        db = self._opened()
        if db is None or not self._memory:
            return
        rows = list(self._memory)
        try:
            with db:
                db.executemany(
                    "INSERT INTO waiting (series, id, topic, retain, body) VALUES (?, ?, ?, ?, ?)",
                    [(m.series, m.id, m.topic, int(m.retain), m.body) for m in rows],
                )
        except sqlite3.Error as error:
            self._failed(error)
            return
        self._memory.clear()
        self._bytes += sum(len(m.body) for m in rows)
        if self._bytes > self._max_bytes:
            self._thin(db)

    def _thin(self, db: sqlite3.Connection) -> None:
        gone = 0
        try:
            with db:
                while self._bytes > self._max_bytes:
                    rows = db.execute(
                        "DELETE FROM waiting WHERE number IN "
                        "(SELECT number FROM waiting ORDER BY number LIMIT ?) "
                        "RETURNING length(body)",
                        (_AT_ONCE,),
                    ).fetchall()
                    if not rows:
                        break
                    gone += len(rows)
                    self._bytes -= sum(length for (length,) in rows)
        except sqlite3.Error as error:
            self._failed(error)
        if gone:
            self._lose(gone, f"more than {self._max_bytes} bytes wait for the broker")

    def _on_disk(self, count: int) -> list[Waiting]:
        db = self._opened()
        if db is None:
            return []
        try:
            rows = db.execute(
                "SELECT series, id, topic, retain, body FROM waiting ORDER BY number LIMIT ?",
                (count + len(self._sent),),
            ).fetchall()
        except sqlite3.Error as error:
            self._failed(error)
            return []
        found = [Waiting(s, i, topic, bool(retain), body) for s, i, topic, retain, body in rows]
        return [m for m in found if m.key not in self._sent][:count]

    def _forget(self) -> None:
        """Take off the disk what was sent."""
        db = self._opened()
        if db is None or not self._sent:
            return
        try:
            with db:
                for key in self._sent:
                    row = db.execute(
                        "DELETE FROM waiting WHERE series = ? AND id = ? RETURNING length(body)",
                        key,
                    ).fetchone()
                    self._bytes -= row[0] if row else 0
        except sqlite3.Error as error:
            self._failed(error)
        else:
            self._sent.clear()

    def _opened(self) -> sqlite3.Connection | None:
        if self._db is not None or time.monotonic() < self._again:
            return self._db
        try:
            self._db = _open(self._path)
        except sqlite3.DatabaseError as error:
            if _is_damaged(self._path, error):
                self._put_aside(error)
            else:
                self._failed(error)
            return self._db
        except OSError as error:
            self._failed(error)
            return None
        (self._bytes,) = self._db.execute(
            "SELECT coalesce(sum(length(body)), 0) FROM waiting"
        ).fetchone()
        self._said = ""
        return self._db

    def _put_aside(self, error: Exception) -> None:
        aside = self._path.with_name(f"{self._path.name}.damaged")
        self._say(f"{self._path} is damaged ({error}) and put aside as {aside.name}")
        try:
            self._path.replace(aside)
            for end in ("-wal", "-shm"):
                Path(f"{self._path}{end}").unlink(missing_ok=True)
            self._db = _open(self._path)
        except (OSError, sqlite3.Error) as again:
            self._failed(again)

    def _failed(self, error: Exception) -> None:
        """Leave the disk alone for a while; said once, whatever is tried again meanwhile."""
        self._give_up_disk()
        self._again = time.monotonic() + _AGAIN
        if not self._said:
            self._said = f"{self._path} cannot be used: {error}; what waits is kept in memory"
            self._say(self._said)

    def _give_up_disk(self) -> None:
        db, self._db = self._db, None
        if db is not None:
            with contextlib.suppress(sqlite3.Error):
                db.close()

    def _lose(self, count: int, why: str) -> None:
        if not self.lost:
            self._say(f"messages are lost: {why}")
        self.lost += count


def _open(path: Path) -> sqlite3.Connection:
    path.parent.mkdir(parents=True, exist_ok=True)
    db = sqlite3.connect(path, timeout=1.0)
    try:
        (tables,) = db.execute("SELECT count(*) FROM sqlite_master").fetchone()
        (owner,) = db.execute("PRAGMA application_id").fetchone()
        if tables and owner != _OURS:
            raise sqlite3.OperationalError("it is a database of something else")
        db.execute(f"PRAGMA application_id = {_OURS}")
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = NORMAL")
        db.execute(_SCHEMA)
        db.execute("SELECT number FROM waiting LIMIT 1").fetchall()
    except BaseException:
        db.close()
        raise
    return db


def _is_damaged(path: Path, error: sqlite3.DatabaseError) -> bool:
    """Whether it is a database that is broken; what never was one is somebody's."""
    if isinstance(error, sqlite3.OperationalError):
        return False
    with contextlib.suppress(OSError), path.open("rb") as file:
        return file.read(len(_HEAD)) == _HEAD
    return False
