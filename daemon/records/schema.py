"""The database of records: its tables, and how it is opened so that it survives what happens.

SQLite with a write-ahead log: readers never wait for the writer nor it for them, and a process or
a computer that dies leaves a whole file with everything that was committed
(https://sqlite.org/wal.html, https://sqlite.org/pragma.html#pragma_synchronous).
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

VERSION = 1
"""Of the tables."""
LEVELS = ("full", "minutes", "hours")
"""How finely a time is kept: every value, or least, mean and greatest of each minute or hour."""
_TABLES = """
CREATE TABLE runs (
    run INTEGER PRIMARY KEY,
    began REAL NOT NULL,
    abbe TEXT NOT NULL,
    configuration TEXT NOT NULL,
    configuration_sha256 TEXT NOT NULL,
    model TEXT NOT NULL,
    model_sha256 TEXT NOT NULL,
    machine TEXT NOT NULL
);
CREATE TABLE series (
    series INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    unit TEXT NOT NULL
);
CREATE TABLE full (
    series INTEGER NOT NULL, time REAL NOT NULL, value REAL NOT NULL,
    PRIMARY KEY (series, time)
) WITHOUT ROWID;
CREATE TABLE minutes (
    series INTEGER NOT NULL, time REAL NOT NULL,
    least REAL NOT NULL, mean REAL NOT NULL, greatest REAL NOT NULL, count INTEGER NOT NULL,
    PRIMARY KEY (series, time)
) WITHOUT ROWID;
CREATE TABLE hours (
    series INTEGER NOT NULL, time REAL NOT NULL,
    least REAL NOT NULL, mean REAL NOT NULL, greatest REAL NOT NULL, count INTEGER NOT NULL,
    PRIMARY KEY (series, time)
) WITHOUT ROWID;
CREATE TABLE events (
    event INTEGER PRIMARY KEY,
    time REAL NOT NULL,
    level TEXT NOT NULL,
    part TEXT NOT NULL,
    message TEXT NOT NULL
);
CREATE INDEX events_by_time ON events (time);
"""
_MARKS = """
CREATE TABLE identity (id TEXT NOT NULL);
CREATE TABLE touched (minute INTEGER PRIMARY KEY, mark INTEGER NOT NULL);
CREATE UNIQUE INDEX touched_by_mark ON touched (mark);
INSERT INTO identity VALUES (lower(hex(randomblob(16))));
INSERT INTO touched SELECT minute, row_number() OVER (ORDER BY minute) FROM (
    SELECT DISTINCT CAST(floor(time / 60) * 60 AS INTEGER) AS minute FROM full
    UNION SELECT CAST(time AS INTEGER) FROM minutes UNION SELECT CAST(time AS INTEGER) FROM hours);
"""
"""Which file it is, and which minutes were written to in which order: what is uploaded goes by it.

Files of earlier versions of Abbe get them when they are written the next time.
"""
CACHE = 512
"""KiB of the file that whoever has it open keeps in memory."""
_APPLICATION = 0x41626265
"""``Abbe``, in the file's head: tells its databases from others."""


class NotRecordsError(sqlite3.DatabaseError):
    """A database that is none of Abbe's records, or of a version that this Abbe does not know."""


def open_to_write(path: Path) -> sqlite3.Connection:
    """Open, or make, a database of records for its only writer.

    Raises
    ------
    sqlite3.OperationalError
        When the file cannot be opened or written.
    sqlite3.DatabaseError
        When it is damaged; `NotRecordsError` when it is another's.
    """
    connection = sqlite3.connect(path, timeout=5.0, isolation_level=None)
    try:
        (tables,) = connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        if tables:
            _require_ours(connection, path)
        connection.execute("PRAGMA journal_mode = WAL")
        # what is committed is on the disk, also when the power fails
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA wal_autocheckpoint = 2000")
        # enough for the last page of every series; SQLite's own 2 MB would fill for an hour
        connection.execute(f"PRAGMA cache_size = -{CACHE}")
        if not tables:
            with connection:
                connection.execute("BEGIN IMMEDIATE")
                for statement in _TABLES.split(";\n"):
                    connection.execute(statement)
                connection.execute(f"PRAGMA application_id = {_APPLICATION}")
                connection.execute(f"PRAGMA user_version = {VERSION}")
        (marked,) = connection.execute(
            "SELECT count(*) FROM sqlite_schema WHERE name = 'touched'"
        ).fetchone()
        if not marked:
            with connection:
                connection.execute("BEGIN IMMEDIATE")
                for statement in _MARKS.split(";\n"):
                    connection.execute(statement)
    except BaseException:
        connection.close()
        raise
    return connection


def open_to_read(path: Path) -> sqlite3.Connection:
    """Open a database of records without changing it, also while it is written.

    Raises
    ------
    sqlite3.OperationalError, NotRecordsError
        When there is none.
    """
    # a reader of a write-ahead log needs its index beside it, which only a writer of the folder can
    # make; where that is not allowed the file alone is read
    for mode in ("ro", "ro&immutable=1"):
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode={mode}", uri=True)
        try:
            _require_ours(connection, path)
            # an index is walked along once: nothing that is kept is asked for again
            connection.execute(f"PRAGMA cache_size = -{CACHE}")
        except NotRecordsError:
            connection.close()
            raise
        except sqlite3.OperationalError:
            connection.close()
            if mode != "ro":
                raise
        except BaseException:
            connection.close()
            raise
        else:
            return connection
    raise AssertionError


def _require_ours(connection: sqlite3.Connection, path: Path) -> None:
    with closing(connection.execute("PRAGMA application_id")) as found:
        (application,) = found.fetchone()
    if application != _APPLICATION:
        raise NotRecordsError(f"{path}: a database, but none of Abbe's records")
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version != VERSION:
        raise NotRecordsError(f"{path}: records of version {version}; this Abbe reads {VERSION}")
