"""Questions to a machine's records: which series, what was between two times, what made a part."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from abbe.compcore.errors import InputError
from abbe.daemon.records.schema import LEVELS, open_to_read
from abbe.daemon.records.writer import EventRow, RunRow

_RUN = "began, abbe, configuration, configuration_sha256, model, model_sha256, machine"


@dataclass(frozen=True, slots=True)
class RecordedSpan:
    """A series between two times.

    Attributes
    ----------
    name, unit
        Of the series.
    least, mean, greatest
        In its unit; the mean is over what was kept.
    count
        Values that it follows from.
    """

    name: str
    unit: str
    least: float
    mean: float
    greatest: float
    count: int


class _Level(NamedTuple):
    """How a level is asked for one span of time; `half` of its own span, s."""

    table: str
    half: float
    query: str


_SPANS = (
    _Level(
        "full",
        0.0,
        "SELECT min(value), sum(value), max(value), count(*) FROM full "
        "WHERE series = ? AND time >= ? AND time < ?",
    ),
    *(
        _Level(
            table,
            half,
            f"SELECT min(least), sum(mean * count), max(greatest), sum(count) FROM {table} "
            "WHERE series = ? AND time >= ? AND time < ?",
        )
        for table, half in (("minutes", 30.0), ("hours", 1800.0))
    ),
)


@dataclass(frozen=True, slots=True)
class ThinnedSeries:
    """Series in equal spans of time; spans without a value are left out.

    Attributes
    ----------
    time
        Middle of each span, s since 1970.
    values
        Series → least, mean and greatest of each span; None where it has none.
    width
        Of a span, s.
    """

    time: list[float]
    values: dict[str, list[tuple[float, float, float] | None]]
    width: float


class Records:
    """A database of records, open to be read.

    Parameters
    ----------
    connection
        From `open_to_read`.
    """

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection

    def range(self) -> tuple[float, float] | None:
        """First and last time of anything kept, s since 1970; None: nothing is."""
        # series by series: the index knows the ends of each, and nothing is read through
        ends = "(SELECT {end}(time) FROM {table} WHERE {table}.series = series.series)"
        parts = " UNION ALL ".join(
            "SELECT " + ends.format(end="min", table=t) + " AS a, "
            + ends.format(end="max", table=t) + " AS b FROM series"
            for t in LEVELS
        )  # fmt: skip
        # of the events, likewise, one end at a time
        parts += " UNION ALL SELECT (SELECT min(time) FROM events), (SELECT max(time) FROM events)"
        first, last = self._connection.execute(f"SELECT min(a), max(b) FROM ({parts})").fetchone()
        return None if first is None else (first, last)

    def series(self) -> dict[str, str]:
        """Name → unit of all series."""
        return dict(self._connection.execute("SELECT name, unit FROM series ORDER BY series"))

    def runs(self, first: float, last: float) -> list[RunRow]:
        """Runs that had begun by `last`, from the one that was under way at `first` on."""
        rows = self._connection.execute(
            f"SELECT {_RUN} FROM runs WHERE began <= ? AND began >= "
            "coalesce((SELECT max(began) FROM runs WHERE began <= ?), 0) ORDER BY began, run",
            (last, first),
        )
        return [RunRow(*row) for row in rows]

    def events(self, first: float, last: float, levels: Sequence[str] = ()) -> list[EventRow]:
        """Events between two times, of these levels where any are named."""
        wanted = f" AND level IN ({', '.join('?' * len(levels))})" if levels else ""
        rows = self._connection.execute(
            "SELECT time, level, part, message FROM events "
            f"WHERE time BETWEEN ? AND ?{wanted} ORDER BY time, event",
            (first, last, *levels),
        )
        return [EventRow(*row) for row in rows]

    def spans(self, first: float, last: float, names: Sequence[str] = ()) -> list[RecordedSpan]:
        """Least, mean and greatest of series between two times, however finely they are kept.

        Raises
        ------
        InputError
            For a series that there is not.
        """
        found = []
        for name, unit in self._named(names):
            parts = (
                "SELECT value AS least, value AS mean, value AS greatest, 1 AS count FROM full "
                "WHERE series = :series AND time BETWEEN :first AND :last",
                "SELECT least, mean, greatest, count FROM minutes "
                "WHERE series = :series AND time BETWEEN :first - 60 AND :last",
                "SELECT least, mean, greatest, count FROM hours "
                "WHERE series = :series AND time BETWEEN :first - 3600 AND :last",
            )
            (row,) = self._connection.execute(
                "SELECT min(least), sum(mean * count) / sum(count), max(greatest), sum(count) "
                f"FROM ({' UNION ALL '.join(parts)})",
                {"series": self._number(name), "first": first, "last": last},
            ).fetchall()
            if row[3]:
                found.append(RecordedSpan(name, unit, *row))
        return found

    def values(
        self, first: float, last: float, names: Sequence[str] = ()
    ) -> Iterator[tuple[float, str, float, float, float]]:
        """Time, name, least, mean and greatest between two times, in order of time."""
        numbers = {self._number(name): name for name, _ in self._named(names)}
        marks = ", ".join("?" * len(numbers))
        parts = [
            f"SELECT time, series, {columns} FROM {level} "
            f"WHERE series IN ({marks}) AND time BETWEEN ? AND ?"
            for level, columns in zip(
                LEVELS,
                ("value, value, value", "least, mean, greatest", "least, mean, greatest"),
                strict=True,
            )
        ]
        rows = self._connection.execute(
            f"{' UNION ALL '.join(parts)} ORDER BY time, series",
            (*numbers, first, last) * len(LEVELS),
        )
        for time, number, least, mean, greatest in rows:
            yield time, numbers[number], least, mean, greatest

    def thinned(self, first: float, last: float, names: Sequence[str], most: int) -> ThinnedSeries:
        """Least, mean and greatest of series in at most so many equal spans between two times.

        Raises
        ------
        InputError
            For a series that there is not.
        """
        width = max((last - first) / most, 1e-3)
        found: dict[int, dict[str, tuple[float, float, float]]] = {}
        for name, _ in self._named(names):
            number = self._number(name)
            levels = [level for level in _SPANS if self._has(level, number, first, last)]
            for span in range(most):
                begin = first + span * width
                value = self._one_span(levels, number, begin, begin + width)
                if value is not None:
                    found.setdefault(span, {})[name] = value
        spans = sorted(found)
        return ThinnedSeries(
            [first + (span + 0.5) * width for span in spans],
            {name: [found[span].get(name) for span in spans] for name in names},
            width,
        )

    def _has(self, level: _Level, number: int, first: float, last: float) -> bool:
        """Whether a level keeps anything of a series between two times."""
        (there,) = self._connection.execute(
            f"SELECT EXISTS (SELECT 1 FROM {level.table} "
            "WHERE series = ? AND time BETWEEN ? AND ?)",
            (number, first - level.half, last - level.half),
        ).fetchone()
        return bool(there)

    def _one_span(
        self, levels: Sequence[_Level], number: int, begin: float, end: float
    ) -> tuple[float, float, float] | None:
        """Least, mean and greatest of one span: a walk along the index, nothing is sorted."""
        least, total, greatest, count = math.inf, 0.0, -math.inf, 0
        for level in levels:
            low, own, high, many = self._connection.execute(
                level.query, (number, begin - level.half, end - level.half)
            ).fetchone()
            if many:
                least, greatest = min(least, low), max(greatest, high)
                total, count = total + own, count + many
        return (least, total / count, greatest) if count else None

    def _named(self, names: Sequence[str]) -> list[tuple[str, str]]:
        there = self.series()
        for name in names:
            if name not in there:
                raise InputError(
                    "no such series in the records",
                    field="--series",
                    found=name,
                    expected=", ".join(there) or "none is kept yet",
                )
        return [(name, there[name]) for name in names or there]

    def _number(self, name: str) -> int:
        (number,) = self._connection.execute(
            "SELECT series FROM series WHERE name = ?", (name,)
        ).fetchone()
        return int(number)


@contextmanager
def opened(path: Path) -> Iterator[Records]:
    """A database of records, read while the context lasts; it may be written meanwhile.

    Raises
    ------
    InputError
        When there is none, or it is damaged.
    """
    if not path.is_file():
        raise InputError(
            "no records here", file=path, expected="a file that `abbe run` keeps by [records]"
        )
    try:
        connection = open_to_read(path)
    except sqlite3.Error as error:
        raise InputError(f"cannot be read: {error}", file=path) from None
    try:
        yield Records(connection)
    except sqlite3.Error as error:
        raise InputError(f"cannot be read: {error}", file=path) from None
    finally:
        connection.close()
