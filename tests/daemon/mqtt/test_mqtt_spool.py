"""What waits for the broker: kept over a restart, bounded, in order, whatever the disk does."""

from __future__ import annotations

import contextlib
import json
import sqlite3
from pathlib import Path

import pytest

from abbe.daemon.mqtt import spool as spool_module
from abbe.daemon.mqtt.messages import Message
from abbe.daemon.mqtt.spool import Spool, Waiting


def filled(path: Path, count: int, max_bytes: int = 1_000_000) -> tuple[Spool, list[str]]:
    said: list[str] = []
    spool = Spool(path, max_bytes, said.append)
    put(spool, count)
    return spool, said


def put(spool: Spool, count: int, text: str = "x") -> None:
    for _ in range(count):
        spool.add(Message("events", {"text": text}, retain=False))


def keys(waiting: list[Waiting]) -> list[tuple[str, int]]:
    return [message.key for message in waiting]


def test_what_waits_outlives_the_process(tmp_path: Path) -> None:
    path = tmp_path / "mqtt.sqlite"
    first, _ = filled(path, 5)
    first.done(first.oldest(1)[0])
    # nothing is closed: it was killed
    second, _ = filled(path, 2)
    wanted = [(first.series, n) for n in range(2, 6)] + [(second.series, n) for n in (1, 2)]
    assert keys(second.oldest(100)) == wanted
    assert first.series != second.series
    assert keys(second.oldest(3)) == wanted[:3]


def test_the_oldest_go_when_too_much_waits(tmp_path: Path) -> None:
    spool, said = filled(tmp_path / "mqtt.sqlite", 0, max_bytes=100_000)
    put(spool, 1000, "x" * 1000)
    ids = [message.id for message in spool.oldest(2000)]
    assert ids == list(range(ids[0], 1001))
    assert spool.lost == ids[0] - 1 > 800
    assert sum(len(m.body) for m in spool.oldest(2000)) <= 100_000
    assert len(said) == 1
    assert "more than 100000 bytes wait" in said[0]


def test_a_full_disk_loses_nothing_while_memory_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mqtt.sqlite"
    monkeypatch.setattr(spool_module, "_AGAIN", 0.0)
    real = spool_module._open
    full = [True]

    def limited(file: Path) -> sqlite3.Connection:
        db = real(file)
        if full[0]:
            # SQLite itself then says what it says of a full disk
            db.execute("PRAGMA max_page_count = 40")
        return db

    monkeypatch.setattr(spool_module, "_open", limited)
    spool, said = filled(path, 0)
    put(spool, 500, "x" * 1000)
    assert said[0].endswith("database or disk is full; what waits is kept in memory")
    assert [message.id for message in spool.oldest(1000)] == list(range(1, 501))
    for message in spool.oldest(7):
        spool.done(message)
    assert [message.id for message in spool.oldest(1000)] == list(range(8, 501))
    full[0] = False
    spool._give_up_disk()
    put(spool, 1)
    assert [message.id for message in spool.oldest(1000)] == list(range(8, 502))
    # all on the disk again
    spool.close()
    assert [message.id for message in filled(path, 0)[0].oldest(1000)] == list(range(8, 502))
    assert spool.lost == 0


def test_memory_is_bounded_where_there_is_no_disk(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder", "utf-8")
    spool, said = filled(tmp_path / "file" / "mqtt.sqlite", 2100)
    assert len(said) == 2
    assert [message.id for message in spool.oldest(5000)] == list(range(101, 2101))
    assert spool.lost == 100


def test_a_damaged_file_is_put_aside(tmp_path: Path) -> None:
    path = tmp_path / "mqtt.sqlite"
    filled(path, 50)[0].close()
    held = path.read_bytes()
    path.write_bytes(held[:100] + b"\xff" * (len(held) - 100))
    spool, said = filled(path, 3)
    assert "put aside as mqtt.sqlite.damaged" in said[0]
    assert [message.id for message in spool.oldest(10)] == [1, 2, 3]
    assert (tmp_path / "mqtt.sqlite.damaged").read_bytes().endswith(b"\xff" * 1000)


@pytest.mark.parametrize("kind", ["text", "database"])
def test_what_is_somebody_else_s_is_left_alone(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "mqtt.sqlite"
    if kind == "text":
        path.write_bytes(b"somebody's notes\n" * 1000)
    else:
        with contextlib.closing(sqlite3.connect(path)) as db:
            db.execute("CREATE TABLE waiting (guests TEXT)")
    before = path.read_bytes()
    spool, said = filled(path, 3)
    assert [message.id for message in spool.oldest(10)] == [1, 2, 3]
    spool.close()
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["mqtt.sqlite"]
    assert "what waits is kept in memory" in said[0]


@pytest.mark.parametrize("text", ["\x00\x1f\x7f", "\ud800", "µ°→\U0001f600", '"}{\\', "\n\r"])
def test_any_text_is_json_in_ascii(tmp_path: Path, text: str) -> None:
    spool, _ = filled(tmp_path / "mqtt.sqlite", 0)
    put(spool, 1, text)
    (found,) = spool.oldest(1)
    assert found.body.isascii()
    assert json.loads(found.body)["text"] == text


def test_what_is_longer_than_any_message_is_lost_alone(tmp_path: Path) -> None:
    spool, said = filled(tmp_path / "mqtt.sqlite", 1)
    put(spool, 1, "x" * 300_000)
    put(spool, 1)
    assert [message.id for message in spool.oldest(10)] == [1, 3]
    assert spool.lost == 1
    assert "is not published" in said[0]
