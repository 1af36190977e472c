"""Damage to records that nobody reads: found while Abbe runs; a sound file is never accused."""

from __future__ import annotations

import random
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.records import whole_file, writer
from abbe.daemon.records.reading import opened
from abbe.daemon.records.thinning import Retention
from abbe.daemon.records.writer import RecordWriter, RunRow

PATIENCE = 60.0
RUN = RunRow(1.0, "0.1.0", "c.toml", "c" * 64, "m.toml", "a" * 64, "Mill 7")


def until(what: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Records that are looked at without a pause."""
    monkeypatch.setattr(whole_file, "_FIRST", 0.0)
    monkeypatch.setattr(whole_file, "_EVERY", 0.0)
    monkeypatch.setattr(whole_file, "_PAUSE", 0.0)
    monkeypatch.setattr(writer, "COMMIT_EVERY", 0.02)
    monkeypatch.setattr(writer, "_AGAIN", 0.1)
    return tmp_path / "records.sqlite"


def rows(at: float) -> list[writer.Value]:
    return [
        (f"s{number}", "mm", at + 1e-3 * k, float(k)) for number in range(5) for k in range(200)
    ]


def asides(path: Path) -> list[Path]:
    return [p for p in path.parent.glob("*.damaged-*") if p.name[-1].isdigit()]


def test_pages_that_nobody_reads_any_more(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The middle is overwritten; what comes goes on at the file's end."""
    writing = RecordWriter(path, Retention())
    try:
        writing.put(RUN)
        for hour in range(30):
            writing.put(rows(3600.0 * hour))

        def checkpointed() -> bool:
            with sqlite3.connect(path) as other:
                done = other.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0] == 0
            other.close()
            return done and path.stat().st_size > 500_000

        until(checkpointed)
        with path.open("r+b") as file:
            file.seek(path.stat().st_size // 2)
            file.write(random.Random(1).randbytes(40_000))
        until(lambda: asides(path))
        writing.put(rows(1e6))

        def begun_anew() -> bool:
            try:
                with opened(path) as records:
                    return bool(records.series()) and len(records.runs(0.0, 2e6)) == 1
            except (InputError, sqlite3.Error):
                return False

        until(begun_anew)
    finally:
        writing.close()
    assert "the records were damaged (" in caplog.text
    assert len(asides(path)) == 1
    # what is whole in it can still be had
    with sqlite3.connect(asides(path)[0]) as aside:
        assert aside.execute("SELECT count(*) FROM runs").fetchone() == (1,)
    aside.close()


def test_a_sound_file_is_not_accused_while_it_is_written(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    looked: list[str] = []
    real = whole_file.WholeFileLooks._read
    monkeypatch.setattr(
        whole_file.WholeFileLooks, "_read", lambda self: looked.append(real(self)) or looked[-1]
    )
    monkeypatch.setattr(writer, "_THIN_EVERY", 0.1)
    writing = RecordWriter(path, Retention(full_days=1.0))
    try:
        writing.put(RUN)
        now = time.time()
        number = 0
        while len(looked) < 8:
            number += 1
            # half of it is old enough to be thinned at once
            writing.put(rows(now - 86400.0 * (number % 4) + number))
            time.sleep(0.05)
    finally:
        writing.close()
    assert set(looked) == {""}
    assert not asides(path)
    assert not caplog.messages


def test_the_end_does_not_wait_for_a_look(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[bool] = []

    def without_end(self: whole_file.WholeFileLooks) -> str:
        with sqlite3.connect(":memory:", check_same_thread=False) as connection:
            self._connection = connection
            begun.append(True)
            with pytest.raises(sqlite3.OperationalError, match="interrupted"):
                connection.execute(
                    "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
                    "SELECT count(*) FROM n"
                ).fetchone()
        connection.close()
        return ""

    monkeypatch.setattr(whole_file.WholeFileLooks, "_read", without_end)
    writing = RecordWriter(path, Retention())
    writing.put(rows(1.0))
    until(lambda: begun)
    time.sleep(0.1)
    began = time.monotonic()
    writing.close()
    assert time.monotonic() - began < 4.0
