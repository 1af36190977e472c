"""The journal: seals, torn lines, tampering; the lock; backups; what `abbe run` says of it."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.upload.history import backups
from abbe.daemon.upload.history.content import Content, checksum
from abbe.daemon.upload.history.log_head import path_of
from abbe.daemon.upload.history.unfinished import unfinished_in
from abbe.daemon.upload.history.upload_log import FIRST, Journal, read_journal
from abbe.daemon.upload.lock import only_one


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
    with pytest.raises(InputError, match="the journal was changed") as caught:
        read_journal(path)
    assert caught.value.line in (2, 3)
    assert "the journal was changed" in unfinished_in(path)


@given(cut=st.integers(1, 400), again=st.integers(0, 400))
def test_power_cuts_tear_the_last_line_and_the_next_says_so(
    tmp_path_factory: pytest.TempPathFactory, cut: int, again: int
):
    path = tmp_path_factory.mktemp("journal") / "uploads.jsonl"
    written(path, line("a", "begin"))
    last = path.stat().st_size

    def torn(step: str, by: int) -> None:
        """A power cut while a line is written: the head is written after it."""
        head = path_of(path).read_bytes()
        written(path, line("a", step))
        whole = path.read_bytes()
        path.write_bytes(whole[: max(last, len(whole) - by)])
        path_of(path).write_bytes(head)

    torn("stage", cut)
    assert read_journal(path).entries[0]["step"] == "begin"
    # and once more, in the line after it
    torn("recover", again)
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


def test_the_last_line_is_sealed_by_the_head(tmp_path: Path):
    path = tmp_path / "uploads.jsonl"
    written(path, line("a", "begin"), line("a", "end", active="old"))
    whole, head = path.read_bytes(), path_of(path).read_bytes()
    path.write_bytes(whole.replace(b'"active": "old"', b'"active": "new"'))
    with pytest.raises(InputError, match="the journal was changed: its last line is another"):
        read_journal(path)
    path.write_bytes(whole[: whole.index(b"\n") + 1])
    with pytest.raises(InputError, match="1 lines at its end are missing") as caught:
        read_journal(path)
    assert "put both files aside" in str(caught.value)
    path.unlink()
    with pytest.raises(InputError, match="2 lines at its end are missing"):
        read_journal(path)
    # killed between the line and the head: the head is one line behind
    path.write_bytes(whole)
    first = json.loads(whole.splitlines()[1])["previous"]
    path_of(path).write_text(head.decode().replace('"lines": 2', '"lines": 1'))
    with pytest.raises(InputError, match="its last line is another"):
        read_journal(path)
    behind = {"format": "abbe-uploads-head/1", "lines": 1, "last": first}
    path_of(path).write_text(json.dumps(behind))
    assert len(read_journal(path).entries) == 2
    # a head that was lost is no reason to refuse
    path_of(path).unlink()
    assert len(read_journal(path).entries) == 2
    for bad in ("[]", "x", "[" * 100_000, '{"format": "abbe-uploads-head/1", "lines": "2"}'):
        path_of(path).write_text(bad)
        with pytest.raises(InputError, match=r"uploads\.jsonl\.head"):
            read_journal(path)


@pytest.mark.parametrize(
    "more",
    [{"old": 3}, {"new": None}, {"tool_mm": [1, 2]}, {"tool_mm": "abc"}, {"backup": 7},
     {"active": ["new"]}, {"who": {}}, {"model": "m"}, {"time": 5}],
)  # fmt: skip
def test_wrong_types_in_a_line_are_one_error(tmp_path: Path, more: dict[str, object]):
    path = tmp_path / "uploads.jsonl"
    written(path, line("a", "begin"), line("a", "end", **more))
    with pytest.raises(InputError, match=r"uploads\.jsonl, line 2, field '") as caught:
        read_journal(path)
    assert next(iter(more)) in str(caught.value)
    assert "line 2" in unfinished_in(path)


@pytest.mark.parametrize("content", ['format = "abbe-model/1"\n', "a,b\n1,2\n", '{"a": 1}\n'])
def test_another_file_is_no_journal_and_is_left_alone(tmp_path: Path, content: str):
    path = tmp_path / "model.toml"
    path.write_text(content)
    with pytest.raises(InputError, match="is not a journal of uploads"):
        Journal(path)
    assert "is not a journal" in unfinished_in(path)
    assert path.read_text() == content


@pytest.mark.parametrize("start", [b"", b"{", b'{"format": "abbe-upl', b"\0" * 300])
def test_a_first_line_that_was_torn_is_a_journal(tmp_path: Path, start: bytes):
    path = tmp_path / "uploads.jsonl"
    path.write_bytes(start)
    written(path, line("a", "begin"))
    assert len(read_journal(path).entries) == 1


def test_a_full_disk_leaves_no_part_of_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "uploads.jsonl"
    journal = Journal(path)
    journal.append(line("a", "begin"))
    whole = path.read_bytes()
    write = os.write
    room = [10]

    def almost_full(descriptor: int, data: bytes) -> int:
        if not room:
            raise OSError(28, "No space left on device")
        return write(descriptor, data[: room.pop()])

    with monkeypatch.context() as full:
        full.setattr(os, "write", almost_full)
        with pytest.raises(InputError, match="cannot be written: No space left"):
            journal.append(line("a", "stage"))
    assert path.read_bytes() == whole
    journal.append(line("a", "end"))
    assert [e["step"] for e in read_journal(path).entries] == ["begin", "end"]


def test_the_lock_leaves_everything_else_alone(tmp_path: Path):
    path = tmp_path / "uploads.jsonl"
    lock = tmp_path / "uploads.jsonl.lock"
    model = tmp_path / "model.toml"
    model.write_text("precious")
    lock.symlink_to(model)
    with pytest.raises(InputError, match="symbolic link"), only_one(path):
        pass
    lock.unlink()
    lock.hardlink_to(model)
    with pytest.raises(InputError, match="is not the lock of an upload"), only_one(path):
        pass
    lock.unlink()
    lock.write_text("precious")
    with pytest.raises(InputError, match="found 'precious'"), only_one(path):
        pass
    assert (model.read_text(), lock.read_text()) == ("precious", "precious")
    lock.unlink()
    os.mkfifo(lock)
    with pytest.raises(InputError, match="is not the lock"), only_one(path):
        pass


def test_a_full_disk_at_the_lock_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(os, "pwrite", full)
        refused = pytest.raises(InputError, match="No space left.*nothing was uploaded")
        with refused, only_one(tmp_path / "uploads.jsonl"):
            pass
    with only_one(tmp_path / "uploads.jsonl") as left:
        assert left == ""


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
