"""``abbe records`` as typed, on a file that was made row by row."""

from __future__ import annotations

import csv
import json
from datetime import datetime
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.answers.part_trace import part, part_text
from abbe.daemon.arguments.moments import moment
from abbe.daemon.records.reading import opened
from abbe.daemon.records.schema import open_to_write
from abbe.daemon.records.thinning import Retention, thin
from abbe.daemon.upload.history.upload_log import Journal
from tests.support.daemon.command_line import abbe as run

NOW = datetime(2026, 11, 22, 15, 0, 0).astimezone()
BEGAN = datetime(2026, 11, 22, 14, 0, 0).astimezone().timestamp()
IN_FULL = 0x7003


@pytest.fixture
def records(tmp_path: Path) -> Path:
    path = tmp_path / "r.sqlite"
    connection = open_to_write(path)
    connection.execute(
        "INSERT INTO runs VALUES (1, ?, '0.1.0', '/etc/c.toml', ?, '/etc/m.toml', ?, 'Mill 7')",
        (BEGAN - 60.0, "c" * 64, "a" * 64),
    )
    series = [("status", ""), ("correction_X", "mm"), ("T_x", "degC")]
    for number, (name, unit) in enumerate(series, 1):
        connection.execute("INSERT INTO series VALUES (?, ?, ?)", (number, name, unit))
    for n in range(100):
        word = IN_FULL if n % 4 else 0x0005
        for number, value in enumerate((word, 1e-3 * n, 20.0 + 0.01 * n), 1):
            connection.execute("INSERT INTO full VALUES (?, ?, ?)", (number, BEGAN + n, value))
    connection.execute(
        "INSERT INTO events VALUES (1, ?, 'WARNING', 'abbe.pipeline', 'X: stale')", (BEGAN + 50.0,)
    )
    connection.close()
    return path


def test_a_part_is_traced_to_its_model(records: Path) -> None:
    done = run("records", "part", records, "2026-11-22 14:00:10", "2026-11-22 14:00:29", "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["runs"][0]["model_sha256"] == "a" * 64
    assert found["corrected_in_full"] == pytest.approx(0.75)
    by_name = {s["name"]: s for s in found["series"]}
    assert by_name["correction_X"]["least"] == pytest.approx(0.010)
    assert by_name["correction_X"]["greatest"] == pytest.approx(0.029)
    assert found["warnings"] == []
    text = run("records", "part", records, "2026-11-22 14:00:40", "2026-11-22 14:01:00").out
    assert "SHA-256 aaaaaaaaaaaa" in text
    assert "X: stale" in text
    assert "correction_X" in text
    assert "µm" in text


def test_what_was_out_of_range_is_told_of_a_part(records: Path) -> None:
    times = "2026-11-22 14:00:00", "2026-11-22 14:01:40"
    done = run("records", "part", records, *times)
    assert "outside of what was measured: not known" in done.out
    connection = open_to_write(records)
    for name, unit in (("outside", ""), ("beyond_X", "mm"), ("plus_minus_X", "mm")):
        connection.execute("INSERT INTO series (name, unit) VALUES (?, ?)", (name, unit))
    connection.execute(
        "INSERT INTO full SELECT n.series, time, 0.002 FROM full, series AS n "
        "WHERE full.series = 1 AND n.name IN ('outside', 'plus_minus_X')"
    )
    done = run("records", "part", records, *times)
    assert "outside of what was measured: nothing" in done.out
    assert "plus_minus_X" in done.out
    # ten seconds of a hundred
    connection.execute(
        "INSERT INTO full SELECT n.series, time, -3.0 - 0.1 * (time - ?) FROM full, series AS n "
        "WHERE full.series = 1 AND n.name = 'beyond_X' AND time < ?",
        (BEGAN, BEGAN + 9.5),
    )
    connection.close()
    assert "X: by up to -3.9 mm, in 10 % of the time" in run("records", "part", records, *times).out
    (found,) = json.loads(run("records", "part", records, *times, "--json").out)[
        "beyond_what_was_measured"
    ]
    assert found == {"name": "X", "by": pytest.approx(-3.9), "unit": "mm", "share": 0.1}


def test_the_share_in_full_outlives_thinning(tmp_path: Path) -> None:
    """A part comes back when minutes and hours are all that is left: words of bits say nothing."""
    path = tmp_path / "r.sqlite"
    connection = open_to_write(path)
    connection.execute("INSERT INTO series VALUES (1, 'status', ''), (2, 'in_full', '')")
    for n in range(600):
        full = n % 10 != 3
        connection.execute(
            "INSERT INTO full VALUES (1, ?, ?), (2, ?, ?)",
            (BEGAN + n, IN_FULL if full else 0x0005, BEGAN + n, float(full)),
        )
    thin(connection, Retention(full_days=0.0, minute_days=0.0), BEGAN + 7200.0)
    connection.close()
    times = "2026-11-22 14:00:00", "2026-11-22 14:30:00"
    done = run("records", "part", path, *times, "--json")
    assert json.loads(done.out)["corrected_in_full"] == pytest.approx(0.9)


def test_tables_that_the_controller_had_belong_to_a_part(records: Path) -> None:
    folder = records.parent
    journal = Journal(folder / "u.jsonl")
    for number, active in enumerate(("new", "old", "new")):
        journal.append(
            {"upload": f"{number}", "step": "end", "outcome": "done", "active": active,
             "who": f"anna {number}", "old": "", "new": f"{number}" * 64}
        )  # fmt: skip
    with opened(records) as found:
        now = datetime.now().timestamp()
        trace = part(found, now + 1.0, now + 2.0, folder / "u.jsonl")
        assert [t["who"] for t in trace["tables"]] == ["anna 2"], "the last one that became active"
        trace = part(found, now - 60.0, now + 60.0, folder / "u.jsonl")
        assert [t["who"] for t in trace["tables"]] == ["anna 0", "anna 2"]
        assert "tables 222222222222 on the controller" in "\n".join(part_text(trace, []))
        assert part(found, now - 60.0, now - 50.0, folder / "u.jsonl")["tables"] == []


def test_a_time_without_records_is_said(records: Path) -> None:
    text = run("records", "part", records, "2026-11-22 18:00", "2026-11-22 19:00").out
    assert "nothing was recorded in this time" in text


def test_values_are_exported_as_csv_and_parquet(records: Path, tmp_path: Path) -> None:
    times = ["--from", "2026-11-22 14:00:00", "--to", "2026-11-22 14:00:09", "--series", "T_x"]
    out = tmp_path / "x.csv"
    done = run("records", "export", records, "-o", out, *times)
    assert done.status == 0, done.err
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [float(r["mean"]) for r in rows] == pytest.approx([20.0 + 0.01 * n for n in range(10)])
    assert datetime.fromisoformat(rows[0]["time"]).timestamp() == BEGAN
    from pyarrow import parquet

    done = run("records", "export", records, "-o", tmp_path / "x.parquet", *times)
    assert done.status == 0, done.err
    table = parquet.read_table(tmp_path / "x.parquet")
    assert table["mean"].to_pylist() == pytest.approx([20.0 + 0.01 * n for n in range(10)])
    assert table["time"][0].as_py().timestamp() == BEGAN
    again = run("records", "export", records, "-o", records, *times)
    assert again.status != 0


def test_what_is_kept_is_shown(records: Path) -> None:
    text = run("records", "show", records).out
    assert "Mill 7" in text
    assert "T_x (degC)" in text
    text = run("records", "show", records, "--from", "2026-11-22 14:00", "--series", "T_x").out
    assert "20.99" in text
    connection = open_to_write(records)
    for n in range(30):
        connection.execute(
            "INSERT INTO events (time, level, part, message) VALUES (?, 'INFO', 'abbe.x', ?)",
            (BEGAN + n, f"event {n}"),
        )
    connection.close()
    text = run("records", "show", records, "--from", "2026-11-22 14:00").out
    assert "events: 31, the last 20" in text
    assert "event 29" in text
    assert "event 3\n" not in text
    text = run("records", "show", records, "--from", "2026-11-22 14:00", "--level", "warning").out
    assert "events: 1\n" in text
    assert "X: stale" in text
    assert "not a level" in run("records", "show", records, "--level", "loud").err
    done = run("records", "show", records, "--from", "1h", "--series", "T_y")
    assert done.status == 1
    assert "no such series" in done.err


@pytest.mark.parametrize(
    ("text", "ago"),
    [("now", 0.0), ("2h", 7200.0), ("90 min", 5400.0), ("7d", 604800.0), ("14:30", 1800.0)],
)
def test_moments_as_people_type_them(text: str, ago: float) -> None:
    assert NOW.timestamp() - moment(text, "--from", NOW) == pytest.approx(ago)


@pytest.mark.parametrize("text", ["", "yesterday", "25:00", "2026-13-01", "-", "1e999h", "9" * 400])
def test_what_is_no_moment_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="not a moment"):
        moment(text, "--from", NOW)
