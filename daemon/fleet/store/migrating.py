"""The store's schema: numbered SQL files, each applied once, all in one transaction."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import psycopg

from abbe.compcore.errors import AbbeError

_LOCK = (1633837157, 1)
"""Of PostgreSQL's advisory locks: two that migrate at once wait for each other."""
_BEGIN = """
CREATE SCHEMA IF NOT EXISTS abbe;
CREATE TABLE IF NOT EXISTS abbe.migrations (
    number integer PRIMARY KEY, name text NOT NULL, sha256 text NOT NULL,
    applied timestamptz NOT NULL DEFAULT now())
"""


@dataclass(frozen=True, slots=True)
class Migration:
    """One step of the schema.

    Attributes
    ----------
    number, name
        From its file's name, ``0001_store.sql``.
    text
        Its statements.
    """

    number: int
    name: str
    text: str

    @property
    def sha256(self) -> str:
        """Of its text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def migrations() -> tuple[Migration, ...]:
    """All that this Abbe knows, in order."""
    folder = files("abbe.daemon.fleet.store").joinpath("migrations")
    found = [
        Migration(int(named[1]), named[2], file.read_text("utf-8"))
        for file in folder.iterdir()
        if (named := re.fullmatch(r"(\d{4})_(\w+)\.sql", file.name))
    ]
    return tuple(sorted(found, key=lambda m: m.number))


def migrate(connection: psycopg.Connection[Any]) -> tuple[Migration, ...]:
    """Apply what is missing; returns it. All of it, or nothing.

    Raises
    ------
    AbbeError
        For a store of a newer Abbe, and one whose schema somebody else has made.
    psycopg.Error
        For what the server refuses.
    """
    known = {m.number: m for m in migrations()}
    with connection.transaction():
        connection.execute("SELECT pg_advisory_xact_lock(%s, %s)", _LOCK)
        for statement in _BEGIN.split(";"):
            connection.execute(statement.encode())
        rows = connection.execute("SELECT number, name, sha256 FROM abbe.migrations").fetchall()
        for number, name, sha256 in rows:
            if number not in known:
                raise AbbeError(
                    f"the store has migration {number} ({name}), which this Abbe does not know: it "
                    "is of a newer one"
                )
            if known[number].sha256 != sha256:
                raise AbbeError(f"the store's migration {number} ({name}) is not this Abbe's")
        applied = {row[0] for row in rows}
        missing = tuple(m for m in known.values() if m.number not in applied)
        for migration in missing:
            connection.execute(migration.text.encode())
            connection.execute(
                "INSERT INTO abbe.migrations (number, name, sha256) VALUES (%s, %s, %s)",
                (migration.number, migration.name, migration.sha256),
            )
    return missing


def require_current(connection: psycopg.Connection[Any]) -> None:
    """Make sure that a store has all that this Abbe needs.

    Raises
    ------
    AbbeError
        Where it has not.
    """
    wanted = max(m.number for m in migrations())
    try:
        row = connection.execute("SELECT max(number) FROM abbe.migrations").fetchone()
    except (psycopg.errors.UndefinedTable, psycopg.errors.InvalidSchemaName):
        row = None
    except psycopg.errors.InsufficientPrivilege:
        raise AbbeError(
            "the store does not let this role in: abbe fleet add, abbe fleet reader"
        ) from None
    number = row[0] if row and row[0] is not None else 0
    if number < wanted:
        raise AbbeError(
            f"the store's schema is at {number}, this Abbe needs {wanted}: abbe fleet init"
        )
