"""Looks at the whole file of records now and then: what nobody reads would be damaged unnoticed.

A thread of its own reads it by a connection of its own; neither the cycle nor the writer waits.
SQLite knows a damaged page by its structure, not a number that is another one than was written
(https://sqlite.org/pragma.html#pragma_quick_check).
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
import time
from contextlib import closing
from pathlib import Path

from abbe.daemon.records.schema import CACHE

_FIRST = 300.0
"""s from the start to the first look."""
_EVERY = 3600.0
"""s from one look to the next, and at least so many times as long as the last one took."""
_PAUSE = 200.0
_NICER = 10
_END = 5.0
"""s that a look is given to break off."""


class WholeFileLooks:
    """Looks when it is time, and keeps what was found.

    Parameters
    ----------
    path
        The database.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._due = time.monotonic() + _FIRST
        self._thread: threading.Thread | None = None
        self._connection: sqlite3.Connection | None = None
        self._found: tuple[int, str] = (0, "")

    def damage(self, inode: int) -> str:
        """What is damaged in a file, in SQLite's words; empty where nothing is known to be.

        Begins a look where it is time.

        Parameters
        ----------
        inode
            Of the file that is meant: another one may have taken its place during a look.
        """
        if self._thread is not None:
            if self._thread.is_alive():
                return ""
            self._thread = None
            looked_at, damage = self._found
            return damage if looked_at == inode else ""
        if time.monotonic() >= self._due:
            self._thread = threading.Thread(
                target=self._look, args=(inode,), name="records look", daemon=True
            )
            self._thread.start()
        return ""

    def close(self) -> None:
        """Break off."""
        if self._thread is not None:
            with contextlib.suppress(sqlite3.Error, AttributeError):
                if self._connection is not None:
                    self._connection.interrupt()
            self._thread.join(_END)

    def _look(self, inode: int) -> None:
        # a thread of Linux has a niceness of its own; a confined service may not have it changed
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICER)
        began = time.monotonic()
        self._found = inode, self._read()
        now = time.monotonic()
        self._due = now + max(_EVERY, _PAUSE * (now - began))

    def _read(self) -> str:
        try:
            # never as an immutable file: what is written meanwhile would look like damage
            uri = f"{self._path.resolve().as_uri()}?mode=ro"
            with closing(
                sqlite3.connect(uri, uri=True, timeout=5.0, check_same_thread=False)
            ) as connection:
                self._connection = connection
                connection.execute(f"PRAGMA cache_size = -{CACHE}")
                (first,) = connection.execute("PRAGMA quick_check(1)").fetchone()
        except sqlite3.OperationalError:
            return ""  # it cannot be read at present: the writer says so
        except sqlite3.DatabaseError as error:
            return str(error)
        finally:
            self._connection = None
        return "" if first == "ok" else str(first).rpartition("***")[2].strip()
