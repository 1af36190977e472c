"""The journal: seals, torn lines, tampering; the lock; backups; what `abbe run` says of it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from compcore.errors import AbbeError, InputError
from daemon.upload import backups
from daemon.upload.content import Content, checksum
from daemon.upload.journal import FIRST, Journal, read_journal
from daemon.upload.lock import only_one
from daemon.upload.unfinished import unfinished_in


def line(upload: str, step: str, outcome: str = "done", **more: object) -> dict[str, object]:
    return {"upload": upload, "step": step, "outcome": outcome, "old": "", "new": "ab" * 32} | more


def written(path: Path, *lines: dict[str, object]) -> None:
    journal = Journal(path)
    for entry in lines:
        journal.append(entry)


def test_every_line_carries_the_checksum_of_the_one_before(tmp_path: Path):
    path = tmp_path / "uploads.jsonl"
    written(path, line("a", "begin"), line("a", "stage"))
    written(path, line("a", "end"))
    raw = path.read_bytes().splitlines()
    previous = [json.loads(one)["previous"] for one in raw]
    assert previous == [FIRST, *(hashlib.sha256(one).hexdigest() for one in raw[:-1])]
    assert [e["step"] for e in read_journal(path).entries] == ["begin", "stage", "end"]
    assert all(json.loads(one)["time"].endswith("+00:00") for one in raw)


@pytest.mark.parametrize("change", ["altered", "left_out", "swapped", "doubled", "inserted"])
def test_a_journal_that_was_changed_is_refused(tmp_path: Path, change: str):
    path = tmp_path / "uploads.jsonl"
    written(path, *(line("a", step) for step in ("begin", "stage", "activate", "end")))
    lines = path.read_bytes().splitlines(keepends=True)
    changed = {
        "altered": [lines[0], lines[1].replace(b"stage", b"steal"), *lines[2:]],
        "left_out": [lines[0], *lines[2:]],
        "swapped": [lines[0], lines[2], lines[1], lines[3]],
        "doubled": [lines[0], lines[1], lines[1], *lines[2:]],
        "inserted": [lines[0], b"nothing\n", *lines[1:]],
    }[change]
    path.write_bytes(b"".join(changed))
    with pytest.raises(InputError, match="the journal was changed") as told:
        read_journal(path)
    assert told.value.line in (2, 3)
    assert "the journal was changed" in unfinished_in(path)


@given(cut=st.integers(1, 400), again=st.integers(0, 400))
def test_power_cuts_tear_the_last_line_and_the_next_says_so(
    tmp_path_factory: pytest.TempPathFactory, cut: int, again: int
):
    path = tmp_path_factory.mktemp("journal") / "uploads.jsonl"
    written(path, line("a", "begin"), line("a", "stage"))
    whole = path.read_bytes()
    last = whole.index(b"\n") + 1
    path.write_bytes(whole[: max(last, len(whole) - cut)])
    assert read_journal(path).entries[0]["step"] == "begin"
    written(path, line("a", "recover"))
    # and once more, while that line was written
    whole = path.read_bytes()
    path.write_bytes(whole[: max(last, len(whole) - again)])
    written(path, line("a", "end"))
    found = read_journal(path)
    assert found.entries[0]["step"] == "begin"
    assert found.entries[-1]["step"] == "end"
    assert not found.torn
    assert not found.unfinished()


def test_a_torn_line_that_is_mended_afterwards_is_noticed(tmp_path: Path):
    path = tmp_path / "uploads.jsonl"
    written(path, line("a", "begin"))
    with path.open("ab") as stream:
        stream.write(b'{"format": "abbe-up')
    written(path, line("a", "end"))
    data = path.read_bytes()
    assert read_journal(path).entries[-1]["torn"]
    path.write_bytes(data.replace(b'{"format": "abbe-up\n', b""))
    with pytest.raises(InputError, match="the journal was changed"):
        read_journal(path)


def test_an_upload_without_an_end_is_unfinished(tmp_path: Path):
    path = tmp_path / "uploads.jsonl"
    assert unfinished_in(path) == ""
    written(path, line("a", "begin"), line("a", "end"), line("b", "begin", who="Ada"))
    assert [e["upload"] for e in read_journal(path).unfinished()] == ["b"]
    assert "by Ada (no table → abababababab) was not finished" in unfinished_in(path)
    assert "ends at 'begin'" in unfinished_in(path)


def test_the_lock_is_held_once_and_says_what_a_dead_process_left(tmp_path: Path):
    path = tmp_path / "uploads.jsonl"
    with only_one(path) as left:
        assert left == ""
        with pytest.raises(AbbeError, match="another upload is running"), only_one(path):
            pass
    (tmp_path / "uploads.jsonl.lock").write_text("4711\n")
    with only_one(path) as left:
        assert left == "4711"
    with only_one(path) as left:
        assert left == ""


def test_backups_are_never_overwritten_and_a_changed_one_is_refused(tmp_path: Path):
    content = Content.of({"x.csv": "1\r\n2\n", "y.csv": "µ"})
    first = backups.save(tmp_path / "b", content, "csv", {}, {"upload": "u"})
    second = backups.save(tmp_path / "b", content, "csv", {}, {"upload": "u"})
    assert first != second
    assert backups.load(first) == backups.load(second) == content
    nothing = backups.save(tmp_path / "b", Content.of({}), "csv", {}, {})
    assert backups.load(nothing).none
    (first / "y.csv").write_text("u")
    with pytest.raises(InputError, match="was changed"):
        backups.load(first)
    assert not list((tmp_path / "b").glob(".new-*"))


def test_the_checksum_of_a_set_covers_names_and_texts():
    assert checksum({"a": "1", "b": "2"}) == checksum({"b": "2", "a": "1"})
    assert len({checksum({"a": "1"}), checksum({"b": "1"}), checksum({"a": "2"}), ""}) == 4
