"""A machine's own records as they are uploaded: events, runs, and history thinned to spans.

Everything is read by short questions to the file that a run is writing; none keeps its log long.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass

from abbe.daemon.records.writer import RunRow

_HOUR = 3600
_LATE = 2.0
"""s after a span's end until it counts as complete: the writer commits twice a second."""
_AHEAD = 60.0
"""s before a span's beginning from which on it is one that a wrong clock has written."""
_MARKS = 4000
"""Minutes looked at a time."""


@dataclass(frozen=True, slots=True)
class KeptEvent:
    """One event of the journal, with its number in the file."""

    number: int
    time: float
    level: str
    part: str
    message: str


@dataclass(frozen=True, slots=True)
class SpanRow:
    """Least, mean and greatest of a series in one span of time.

    Attributes
    ----------
    name, unit
        Of the series.
    time
        Beginning, s since 1970.
    span
        s.
    least, mean, greatest, count
        Of the values in it.
    """

    name: str
    unit: str
    time: int
    span: int
    least: float
    mean: float
    greatest: float
    count: int


@dataclass(frozen=True, slots=True)
class Spans:
    """Some spans that are complete.

    Attributes
    ----------
    rows
        Of all series.
    mark
        Everything that was written up to here is uploaded when these are.
    seen
        Span's beginning → the mark up to which it is in `rows`.
    more
        Whether more wait.
    """

    rows: tuple[SpanRow, ...]
    mark: int
    seen: Mapping[int, int]
    more: bool


class RecordsSource:
    """A file of records, read to be uploaded.

    Parameters
    ----------
    connection
        From `open_to_read`.

    Raises
    ------
    sqlite3.OperationalError
        For a file of an earlier Abbe that no run of this one has written to yet.
    """

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        (self.id,) = connection.execute("SELECT id FROM identity").fetchone()

    def events(self, after: int, after_time: float, most: int) -> list[KeptEvent]:
        """The next events after one; from the first on where that one is another by now.

        SQLite gives a number again when all events are gone, so a number alone says nothing.
        """
        there = self._connection.execute(
            "SELECT time FROM events WHERE event = ?", (after,)
        ).fetchone()
        (greatest,) = self._connection.execute(
            "SELECT coalesce(max(event), 0) FROM events"
        ).fetchone()
        if greatest < after or (there is not None and there[0] != after_time):
            after = 0
        rows = self._connection.execute(
            "SELECT event, time, level, part, message FROM events WHERE event > ? "
            "ORDER BY event LIMIT ?",
            (after, most),
        )
        return [KeptEvent(*row) for row in rows]

    def runs(self) -> list[RunRow]:
        """All runs that it knows."""
        rows = self._connection.execute(
            "SELECT began, abbe, configuration, configuration_sha256, model, model_sha256, machine "
            "FROM runs ORDER BY began"
        )
        return [RunRow(*row) for row in rows]

    def spans(self, after: int, span: int, now: float, seen: Mapping[int, int], most: int) -> Spans:
        """The next complete spans that were written to after a mark.

        Parameters
        ----------
        after
            The mark up to which all is uploaded.
        span
            Length of a span, s.
        now
            s since 1970.
        seen
            Spans that are uploaded beyond `after` already.
        most
            Spans at a time.
        """
        touched = self._connection.execute(
            "SELECT minute, mark FROM touched WHERE mark > ? ORDER BY mark LIMIT ?",
            (after, _MARKS),
        ).fetchall()
        rows: list[SpanRow] = []
        taken: dict[int, int] = {}
        mark, waiting, full = after, False, False
        for minute, number in touched:
            begin = minute - minute % span
            done = number <= max(taken.get(begin, 0), seen.get(begin, 0))
            if not done:
                if begin - _AHEAD <= now < begin + span + _LATE:
                    waiting = True
                    continue
                if len(taken) >= most:
                    full = True
                    break
                newest = self._newest(begin, span)
                rows += self._of_span(begin, span, minute)
                taken[begin] = newest
            if not waiting:
                mark = number
        return Spans(tuple(rows), mark, taken, full or (len(touched) == _MARKS and mark > after))

    def _newest(self, begin: int, span: int) -> int:
        (newest,) = self._connection.execute(
            "SELECT max(mark) FROM touched WHERE minute >= ? AND minute < ?", (begin, begin + span)
        ).fetchone()
        return int(newest)

    def _of_span(self, begin: int, span: int, minute: int) -> list[SpanRow]:
        series = self._connection.execute("SELECT series, name, unit FROM series").fetchall()
        found = []
        for number, name, unit in series:
            row = self._values(number, begin, begin + span, hours=span == _HOUR)
            length, at = span, begin
            if not row[3] and span < _HOUR and minute % _HOUR == 0:
                # it was so long ago that only hours are kept
                row = self._values(number, minute, minute + 1, hours=True)
                length, at = _HOUR, minute
            if row[3]:
                found.append(SpanRow(name, unit, at, length, *row))
        return found

    def _values(
        self, series: int, first: int, end: int, *, hours: bool
    ) -> tuple[float, float, float, int]:
        parts = [
            "SELECT value AS least, value AS mean, value AS greatest, 1 AS count FROM full",
            "SELECT least, mean, greatest, count FROM minutes",
        ]
        if hours:
            parts.append("SELECT least, mean, greatest, count FROM hours")
        where = " WHERE series = :series AND time >= :first AND time < :end"
        (row,) = self._connection.execute(
            "SELECT min(least), sum(mean * count) / sum(count), max(greatest), sum(count) "
            f"FROM ({' UNION ALL '.join(part + where for part in parts)})",
            {"series": series, "first": first, "end": end},
        ).fetchall()
        return row[0], row[1], row[2], row[3] or 0
