from __future__ import annotations

import os
import stat

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.atomic import write_atomically, write_together


def test_writes_text_and_bytes(tmp_path):
    path = tmp_path / "a.txt"
    write_atomically(path, "µm\r\n")
    assert path.read_bytes() == b"\xc2\xb5m\r\n"
    write_atomically(path, b"\x00\x01")
    assert path.read_bytes() == b"\x00\x01"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_mode_of_an_existing_file_is_kept(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(0o640)
    write_atomically(path, "new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_failure_leaves_the_old_content_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def full(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"a\.txt: cannot be written: No space left"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_that_is_missing_is_said(tmp_path):
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        write_atomically(tmp_path / "none" / "a.txt", "x")


def test_a_folder_in_the_files_place_is_said(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        write_atomically(tmp_path / "a", "x")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_files_that_belong_together_are_all_old_or_all_new(tmp_path, monkeypatch):
    names = [tmp_path / n for n in "abc"]
    for path in names[:2]:
        path.write_text("old")
    sync, left = os.fsync, [1, 1]

    def full(handle):
        if not left:
            raise OSError(28, "No space left on device")
        left.pop()
        sync(handle)

    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        with pytest.raises(InputError, match=r"c: cannot be written: No space left"):
            write_together(dict.fromkeys(names, "new"))
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a": "old", "b": "old"}
    write_together(dict.fromkeys(names, "new"))
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == dict.fromkeys("abc", "new")
