"""The same rows into the same PostgreSQL: by Abbe's upload, by plain psycopg, by COPY."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psycopg

from abbe.daemon.fleet.uploading.uploader import Uploader
from tests.support.daemon.plant_store import BEGIN, MachineRecords

SERIES, MINUTES = 24, 1440
"""Of one machine, a day in spans of a minute."""
_ROW = "(time, least, mean, greatest, machine, series, span, count)"


@dataclass(frozen=True)
class WayIn:
    """How fast rows go in on one way.

    Attributes
    ----------
    name
        In words.
    rows
        How many.
    wall, processor
        s, and s of the process that sends.
    """

    name: str
    rows: int
    wall: float
    processor: float


def ways_in(folder: Path, store: str, port: int) -> list[WayIn]:
    """A day's rows of one machine, each way into an empty table, with keys and partitions.

    Parameters
    ----------
    folder
        For the machine's own records.
    store
        URL of an administrator of the store.
    port
        Of PostgreSQL.
    """
    records = _day(folder / "day")
    uploader = Uploader(
        records.task(port, "abbe", machine="Day", site="Benchmark", user="day"),
        lambda _level, _text: None,
        lambda: BEGIN + 1e6,
    )
    from abbe.daemon.fleet.store.roles import add_machine

    with psycopg.connect(store, autocommit=True) as connection:
        number = add_machine(connection, "Day", "Benchmark", "benchmark", "day", "")
        found = [_timed("Abbe's upload", SERIES * MINUTES, uploader.once)]
        rows = connection.execute(
            f"SELECT {_ROW[1:-1]} FROM abbe.history WHERE machine = %s".encode(), (number,)
        ).fetchall()
        assert len(rows) == SERIES * MINUTES, len(rows)
        for name, way in (
            ("executemany, one transaction", _executemany),
            ("execute, each row its transaction", _execute),
            ("COPY, one transaction", _copy),
        ):
            connection.execute("DELETE FROM abbe.history WHERE machine = %s", (number,))
            connection.execute("VACUUM abbe.history")
            few = rows if way is not _execute else rows[: len(rows) // 10]

            def put(
                way: Callable[[psycopg.Connection[Any], Sequence[Any]], None] = way,
                few: Sequence[Any] = few,
            ) -> None:
                way(connection, few)

            found.append(_timed(name, len(few), put))
    return found


def _day(folder: Path) -> MachineRecords:
    """A day of readings, three a minute, as a run has written them to its records."""
    records = MachineRecords(folder)
    for hour in range(MINUTES // 60):
        records.write(
            *(
                [
                    (f"T_{k}", "degC", BEGIN + 60.0 * minute + s, 20.0 + 0.01 * k + 1e-3 * minute)
                    for k in range(SERIES)
                ]
                for minute in range(60 * hour, 60 * hour + 60)
                for s in (0.5, 20.5, 40.5)
            )
        )
    return records


def _timed(name: str, rows: int, way: Callable[[], None]) -> WayIn:
    wall, processor = time.perf_counter(), time.process_time()
    way()
    return WayIn(name, rows, time.perf_counter() - wall, time.process_time() - processor)


def _executemany(connection: psycopg.Connection[Any], rows: Sequence[Any]) -> None:
    with connection.transaction(), connection.cursor() as cursor:
        cursor.executemany(_insert(), rows)


def _execute(connection: psycopg.Connection[Any], rows: Sequence[Any]) -> None:
    for row in rows:
        connection.execute(_insert(), row)


def _copy(connection: psycopg.Connection[Any], rows: Sequence[Any]) -> None:
    wanted = f"COPY abbe.history {_ROW} FROM STDIN".encode()
    with connection.transaction(), connection.cursor() as cursor, cursor.copy(wanted) as copy:
        for row in rows:
            copy.write_row(row)


def _insert() -> bytes:
    places = ", ".join(["%s"] * 8)
    return f"INSERT INTO abbe.history {_ROW} VALUES ({places})".encode()
