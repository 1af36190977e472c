"""Thinning against plain arithmetic over the same values."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.errors import InputError
from abbe.daemon.records.reading import Records
from abbe.daemon.records.schema import open_to_write
from abbe.daemon.records.thinning import Retention, thin

DAY = 86400.0


@pytest.fixture
def database(tmp_path: Path) -> Iterator[sqlite3.Connection]:
    connection = open_to_write(tmp_path / "r.sqlite")
    yield connection
    connection.close()


def fill(connection: sqlite3.Connection, values: list[tuple[float, float]]) -> None:
    connection.execute("INSERT OR IGNORE INTO series VALUES (1, 'a', 'mm')")
    with connection:
        connection.execute("BEGIN")
        connection.executemany("INSERT OR REPLACE INTO full VALUES (1, ?, ?)", values)


def test_old_values_become_minutes_and_then_hours(database: sqlite3.Connection) -> None:
    values = [(10.0 * n, float(n % 7)) for n in range(1000)]
    fill(database, values)
    thin(database, Retention(1.0, 2.0, 100.0), 1.0 * DAY + 5000.0)
    kept = database.execute("SELECT time, value FROM full ORDER BY time").fetchall()
    assert kept == [v for v in values if v[0] >= 4980.0]
    rows = database.execute("SELECT * FROM minutes ORDER BY time").fetchall()
    assert len(rows) == 83
    for _, start, least, mean, greatest, count in rows:
        inside = [v for t, v in values if start <= t < start + 60.0]
        assert (least, greatest, count) == (min(inside), max(inside), len(inside))
        assert mean == pytest.approx(sum(inside) / len(inside))
    thin(database, Retention(1.0, 2.0, 100.0), 2.0 * DAY + 3700.0)
    (hour,) = database.execute("SELECT * FROM hours").fetchall()
    inside = [v for t, v in values if t < 3600.0]
    assert hour[2:] == pytest.approx(
        (min(inside), sum(inside) / len(inside), max(inside), len(inside))
    )
    assert database.execute("SELECT count(*) FROM full").fetchone() == (0,)


def test_values_that_come_late_join_their_minute(database: sqlite3.Connection) -> None:
    fill(database, [(0.0, 1.0), (10.0, 3.0)])
    thin(database, Retention(1.0, 1.0, 100.0), 1.0 * DAY + 600.0)
    fill(database, [(20.0, 11.0)])  # the clock was put back
    thin(database, Retention(1.0, 2.0, 100.0), 1.0 * DAY + 600.0)
    (row,) = database.execute("SELECT least, mean, greatest, count FROM minutes").fetchall()
    assert row == (1.0, 5.0, 11.0, 3)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 20_000), st.floats(-1e3, 1e3)), min_size=1, max_size=60),
    st.lists(st.integers(0, 30_000), min_size=1, max_size=4),
)
def test_thinning_loses_no_extreme_and_no_count(
    values: list[tuple[int, float]], looks: list[int]
) -> None:
    connection = sqlite3.connect(":memory:", isolation_level=None)
    from abbe.daemon.records import schema

    for statement in (schema._TABLES + schema._MARKS).split(";\n"):
        connection.execute(statement)
    by_time = {float(t): v for t, v in values}
    fill(connection, list(by_time.items()))
    for look in sorted(looks):
        thin(connection, Retention(1.0, 1.05, 1e4), DAY + look)
    found = connection.execute(
        "SELECT min(a), max(b), sum(n) FROM ("
        "SELECT min(value) a, max(value) b, count(*) n FROM full UNION ALL "
        "SELECT min(least), max(greatest), sum(count) FROM minutes UNION ALL "
        "SELECT min(least), max(greatest), sum(count) FROM hours)"
    ).fetchone()
    connection.close()
    assert found == (min(by_time.values()), max(by_time.values()), len(by_time))


def test_a_file_that_grows_too_large_gives_up_the_oldest(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    connection = open_to_write(path)
    fill(connection, [(float(n), 1.0) for n in range(60_000)])
    thin(connection, Retention(1e3, 2e3, 3e3, 500_000), 60_000.0, path)
    first, last, count = connection.execute(
        "SELECT min(time), max(time), count(*) FROM full"
    ).fetchone()
    connection.close()
    assert last == 59_999.0
    assert first > 1_000.0
    assert 1_000 < count < 60_000


def test_a_picture_has_few_spans_and_no_extreme_is_lost(database: sqlite3.Connection) -> None:
    rng = np.random.default_rng(5)
    start = 3.0 * DAY
    time = start + np.sort(rng.uniform(0.0, 2.0 * DAY, 20_000))
    value = rng.normal(0.0, 1.0, len(time))
    value[777] = 99.0
    fill(database, list(zip(time.tolist(), value.tolist(), strict=True)))
    records = Records(database)
    first, last, spans = start + 3000.0, start + 1.7 * DAY, 120
    found = records.thinned(first, last, ["a"], spans)
    width = (last - first) / spans
    assert len(found.time) == spans
    assert found.width == pytest.approx(width)
    for k, (middle, parts) in enumerate(zip(found.time, found.values["a"], strict=True)):
        assert middle == pytest.approx(first + (k + 0.5) * width)
        inside = value[(time >= first + k * width) & (time < first + (k + 1) * width)]
        assert parts is not None
        assert parts == pytest.approx((inside.min(), inside.mean(), inside.max()))
    # thinned to minutes and hours, it is the same to within what was thinned
    thin(database, Retention(1.0, 1.5, 100.0), start + 2.0 * DAY)
    assert database.execute("SELECT count(*) FROM hours").fetchone()[0] > 5
    coarse = records.thinned(start, start + 2.0 * DAY, ["a"], 40)
    known = [p for p in coarse.values["a"] if p is not None]
    assert max(p[2] for p in known) == 99.0
    assert min(p[0] for p in known) == value.min()
    # what is not there is left out, and a series that is not is said
    assert records.thinned(0.0, 10.0, ["a"], 10).time == []
    with pytest.raises(InputError, match="no such series"):
        records.thinned(0.0, 10.0, ["b"], 10)
