"""Records on the disk: what is kept, what a crash, a full or a damaged disk leave of it."""

from __future__ import annotations

import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from abbe.daemon.records.reading import opened
from abbe.daemon.records.schema import CACHE, open_to_write
from abbe.daemon.records.thinning import Retention
from abbe.daemon.records.writer import EventRow, RecordWriter, RunRow

PATIENCE = 60.0


def until(what: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def count(path: Path, table: str = "full") -> int:
    """Rows, by a connection that shares nothing with Abbe's."""
    with sqlite3.connect(path) as connection:
        found = connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
    connection.close()
    return int(found)


def there(path: Path) -> bool:
    try:
        return path.exists() and count(path) > 0
    except sqlite3.Error:
        return False


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "records.sqlite"


def test_what_is_put_can_be_read_while_it_is_written(path: Path) -> None:
    writer = RecordWriter(path, Retention())
    try:
        writer.put(RunRow(100.0, "0.1", "c.toml", "aa", "m.toml", "bb", "mill"))
        writer.put([("T_x", "degC", 101.0, 20.5), ("T_x", "degC", 102.0, 21.5)])
        writer.put(EventRow(101.5, "WARNING", "abbe.pipeline", "X: stale"))
        until(lambda: there(path))
        with opened(path) as records:
            assert records.series() == {"T_x": "degC"}
            assert records.range() == (101.0, 102.0)
            (span,) = records.spans(0.0, 200.0)
            assert (span.least, span.mean, span.greatest, span.count) == (20.5, 21.0, 21.5, 2)
            assert [r.model_sha256 for r in records.runs(150.0, 200.0)] == ["bb"]
            assert records.runs(0.0, 50.0) == []
            assert [e.message for e in records.events(101.0, 102.0)] == ["X: stale"]
    finally:
        writer.close()
    writer = RecordWriter(path, Retention())
    writer.put([("T_x", "degC", 103.0, 22.0)])
    writer.close()
    assert count(path) == 3


_KILLED = """
import sys, time
from pathlib import Path
from abbe.daemon.records.thinning import Retention
from abbe.daemon.records.writer import RecordWriter
writer = RecordWriter(Path(sys.argv[1]), Retention())
while True:
    writer.put([(f"s{i}", "mm", time.time(), float(i)) for i in range(20)])
    print(time.time(), flush=True)
    time.sleep(0.01)
"""


def test_killed_it_loses_at_most_the_last_second_and_never_the_file(path: Path) -> None:
    for _ in range(3):
        process = subprocess.Popen(
            [sys.executable, "-c", _KILLED, str(path)], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        before = count(path) if path.exists() else 0
        until(lambda n=before: there(path) and count(path) > n)
        process.send_signal(signal.SIGKILL)
        last = float(process.stdout.read().split()[-1])
        process.wait(PATIENCE)
        process.stdout.close()
        with sqlite3.connect(path) as connection:
            assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
            (kept,) = connection.execute("SELECT max(time) FROM full").fetchone()
        connection.close()
        # a busy computer may have kept the thread waiting; commits come twice a second
        assert last - kept < 1.0 + 2.0


_FULL = """
import logging, resource, sys, time
from pathlib import Path
from abbe.daemon.records.thinning import Retention
from abbe.daemon.records.writer import RecordWriter
logging.basicConfig(format="%(levelname)s %(message)s", level=logging.INFO)
path = Path(sys.argv[1])
RecordWriter(path, Retention()).close()
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, resource.RLIM_INFINITY))
writer = RecordWriter(path, Retention())
for n in range(int(sys.argv[2])):
    writer.put([(f"s{i}", "mm", 1e3 * n + time.time(), float(i)) for i in range(200)])
    time.sleep(0.01)
time.sleep(1.5)
writer.close()
print("went on")
"""


def test_a_full_disk_is_said_once_and_stops_nothing(path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _FULL, str(path), "150"],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.stdout == "went on\n"
    assert done.stderr.count("records cannot be written") == 1
    assert "Traceback" not in done.stderr
    with sqlite3.connect(path) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()


def test_a_damaged_file_is_put_aside_and_a_new_one_begun(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path.write_bytes(b"what is this?" * 1000)
    writer = RecordWriter(path, Retention())
    try:
        writer.put([("a", "mm", 1.0, 1.0)])
        until(lambda: any(path.parent.glob("records.sqlite.damaged-*")))
        writer.put([("a", "mm", 2.0, 1.0)])

        def written() -> bool:
            writer.put([("a", "mm", time.time(), 1.0)])
            return there(path)

        until(written)
    finally:
        writer.close()
    (aside,) = path.parent.glob("records.sqlite.damaged-*")
    assert aside.read_bytes().startswith(b"what is this?")
    assert "put aside" in caplog.text


@pytest.mark.parametrize("how", ["replaced by rubbish", "taken away"])
def test_a_new_file_knows_which_model_runs(
    path: Path, how: str, caplog: pytest.LogCaptureFixture
) -> None:
    run = RunRow(1.0, "0.1.0", "c.toml", "c" * 64, "m.toml", "a" * 64, "Mill 7")
    writer = RecordWriter(path, Retention())
    try:
        writer.put(run)
        writer.put([("a", "mm", 2.0, 1.0)])
        until(lambda: there(path))
        if how == "replaced by rubbish":
            other = path.with_name("other")
            other.write_bytes(b"what is this?" * 4000)
            other.replace(path)
        else:
            for file in path.parent.glob("records.sqlite*"):
                file.unlink()

        def begun_anew() -> bool:
            writer.put([("a", "mm", time.time(), 1.0)])
            return "begun anew" in caplog.text and there(path)

        until(begun_anew)
    finally:
        writer.close()
    with opened(path) as records:
        assert records.runs(10.0, 20.0) == [run]


def test_what_model_ran_outlives_a_disk_that_could_not_be_written(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("abbe.daemon.records.writer._AGAIN", 0.1)
    runs = [
        RunRow(n, "0.1.0", "c.toml", "c" * 64, "m.toml", f"{n:.0f}" * 64, "Mill")
        for n in (1.0, 2.0)
    ]
    path.mkdir()
    writer = RecordWriter(path, Retention())
    try:
        for run in runs:
            writer.put(run)
            writer.put([("a", "mm", run.began, 1.0)])
        until(lambda: "records cannot be written" in caplog.text)
        path.rmdir()
        until(lambda: "records are written again" in caplog.text)
    finally:
        writer.close()
    with opened(path) as records:
        assert records.runs(1.5, 20.0) == runs


def test_the_database_of_another_program_is_left_alone(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE theirs (a)")
    connection.close()
    writer = RecordWriter(path, Retention())
    writer.put([("a", "mm", 1.0, 1.0)])
    writer.close()
    assert "none of Abbe's records" in caplog.text
    with sqlite3.connect(path) as connection:
        tables = connection.execute("SELECT name FROM sqlite_schema").fetchall()
    connection.close()
    assert tables == [("theirs",)]


def test_a_folder_that_may_not_be_written_is_said(caplog: pytest.LogCaptureFixture) -> None:
    writer = RecordWriter(Path("/proc/records.sqlite"), Retention())  # not even by root
    writer.put([("a", "mm", 1.0, 1.0)])
    writer.close()
    assert "records cannot be written" in caplog.text


def test_putting_never_waits(path: Path) -> None:
    with sqlite3.connect(path) as holder:
        writer = RecordWriter(path, Retention())
        holder.execute("BEGIN EXCLUSIVE")  # a disk that does not answer
        began = time.process_time()
        for n in range(50_000):
            writer.put([("a", "mm", float(n), 1.0)])
        assert time.process_time() - began < 10.0
        holder.rollback()
        writer.close()
    holder.close()


def test_the_writer_keeps_little_of_the_file_in_memory(path: Path) -> None:
    connection = open_to_write(path)
    assert connection.execute("PRAGMA cache_size").fetchone() == (-CACHE,)
    connection.close()
