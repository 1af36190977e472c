"""Thinning of records: full values become least, mean and greatest of minutes, then of hours."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass
from pathlib import Path

_DAY = 86400.0
_MOST_AT_ONCE = 6.0 * 3600.0
"""s of records that one transaction thins, so that the writer is never away for long."""


@dataclass(frozen=True, slots=True)
class Retention:
    """How long records are kept.

    Attributes
    ----------
    full_days, minute_days, hour_days
        Age in days up to which every value, the minutes and the hours are kept.
    max_bytes
        Size of the file beyond which the oldest goes first.
    """

    full_days: float = 7.0
    minute_days: float = 90.0
    hour_days: float = 3650.0
    max_bytes: int = 2_000_000_000


def thin(
    connection: sqlite3.Connection, retention: Retention, now: float, path: Path | None = None
) -> None:
    """Thin what has grown too old, and what makes the file too large.

    Parameters
    ----------
    connection
        Of the writer.
    retention
        What is kept.
    now
        s since 1970.
    path
        The file, for its size; None: its size is not looked at.
    """
    _coarsen(connection, "minutes", 60.0, now - retention.full_days * _DAY)
    _coarsen(connection, "hours", 3600.0, now - retention.minute_days * _DAY)
    with connection:
        oldest = now - retention.hour_days * _DAY
        connection.execute("DELETE FROM hours WHERE time < ?", (oldest,))
        connection.execute("DELETE FROM events WHERE time < ?", (oldest,))
        connection.execute("DELETE FROM touched WHERE minute < ?", (oldest,))
    if path is not None:
        _shrink(connection, retention.max_bytes)


def _coarsen(connection: sqlite3.Connection, to: str, span: float, before: float) -> None:
    """Move everything before a time (to a whole span) one level on, in pieces."""
    source, columns = (
        ("full", ("value", "value", "value", "1"))
        if to == "minutes"
        else ("minutes", ("least", "mean", "greatest", "count"))
    )
    least, mean, greatest, count = columns
    before -= before % span
    while True:
        (first,) = connection.execute(
            f"SELECT min(first) FROM (SELECT (SELECT min(time) FROM {source} WHERE "
            f"{source}.series = series.series) AS first FROM series)"
        ).fetchone()
        if first is None or first >= before:
            return
        end = min(before, first - first % span + _MOST_AT_ONCE)
        with connection:
            connection.execute("BEGIN IMMEDIATE")
            connection.execute(
                f"INSERT INTO {to} "
                f"SELECT series, floor(time / {span}) * {span} AS span, min({least}), "
                f"sum({mean} * {count}) / sum({count}), max({greatest}), sum({count}) "
                f"FROM {source} WHERE time < ? GROUP BY series, span "
                "ON CONFLICT (series, time) DO UPDATE SET least = min(least, excluded.least), "
                "mean = (mean * count + excluded.mean * excluded.count) "
                "/ (count + excluded.count), greatest = max(greatest, excluded.greatest), "
                "count = count + excluded.count",
                (end,),
            )
            connection.execute(f"DELETE FROM {source} WHERE time < ?", (end,))
            if to == "hours":
                _hours_touched(connection, end)


def _hours_touched(connection: sqlite3.Connection, before: float) -> None:
    """Of minutes that are no longer told apart, only the hour was touched."""
    old = "SELECT minute - minute % 3600 AS hour, mark FROM touched WHERE minute < ?"
    hours = connection.execute(f"SELECT hour, max(mark) FROM ({old}) GROUP BY hour", (before,))
    found = hours.fetchall()
    connection.execute("DELETE FROM touched WHERE minute < ?", (before,))
    connection.executemany("INSERT INTO touched VALUES (?, ?)", found)


def _shrink(connection: sqlite3.Connection, most: int) -> None:
    """Give up the oldest tenth of the coarsest level that there is, until it is small enough."""
    for _ in range(100):
        (pages,) = connection.execute("PRAGMA page_count").fetchone()
        (free,) = connection.execute("PRAGMA freelist_count").fetchone()
        (size,) = connection.execute("PRAGMA page_size").fetchone()
        if (pages - free) * size <= most:
            return
        for table in ("hours", "minutes", "full"):
            first, last = connection.execute(f"SELECT min(time), max(time) FROM {table}").fetchone()
            if first is not None:
                with connection:
                    connection.execute(
                        f"DELETE FROM {table} WHERE time <= ?",
                        (first + 0.1 * (last - first),),
                    )
                break
        else:
            return
