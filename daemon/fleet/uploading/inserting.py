"""Many rows put into a table of the store by one statement, without those that it cannot take."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import psycopg

from abbe.daemon.fleet.store.connecting import Store, one_line

AT = "to_timestamp(%s)"
"""A time in a statement; its value: s since 1970."""
Columns = Mapping[str, str]
"""Name of a column → its type; ``time``: s since 1970."""
Say = Callable[[int, str], None]
"""Takes a level and a sentence for the journal."""


def insert_rows(
    store: Store,
    say: Say,
    table: str,
    columns: Columns,
    rows: Sequence[tuple[Any, ...]],
    conflict: str = "ON CONFLICT DO NOTHING",
) -> None:
    """Insert rows, all in one statement: whether this role may is then asked once, not a row.

    Rows that the store can never take are left out, and said.

    Parameters
    ----------
    store
        Connected as the machine's writer.
    say
        Takes a level and a sentence for the journal.
    table
        Its name, with the name by which `conflict` calls it.
    columns
        What each row has.
    rows
        The rows.
    conflict
        What becomes of a row that is there already.

    Raises
    ------
    psycopg.Error
        When the store is lost, or refuses all of it.
    """
    if not rows:
        return
    sent = {"time": "float8", "jsonb": "text"}
    arrays = ", ".join(f"%s::{sent.get(kind, kind)}[]" for kind in columns.values())
    taken = {"time": "to_timestamp(r.{})", "jsonb": "r.{}::jsonb"}
    values = ", ".join(taken.get(kind, "r.{}").format(name) for name, kind in columns.items())
    names = ", ".join(columns)
    statement = (
        f"INSERT INTO {table} ({names}) "
        f"SELECT {values} FROM unnest({arrays}) AS r({names}) {conflict}"
    )
    try:
        with store.transaction():
            store.execute(statement.encode(), [list(column) for column in zip(*rows, strict=True)])
    except psycopg.DataError as error:
        if len(rows) == 1:
            say(logging.WARNING, f"left out, the store cannot take it: {one_line(error)}")
            return
        half = len(rows) // 2
        insert_rows(store, say, table, columns, rows[:half], conflict)
        insert_rows(store, say, table, columns, rows[half:], conflict)
