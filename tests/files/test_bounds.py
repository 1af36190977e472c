"""TOML and JSON that ask for all the memory, or are of the wrong shape: one error, soon."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.table_set import RECORD_NAME, TableSet, sha256
from abbe.compcore.files.text.toml_bounds import MOST_DEPTH, MOST_ITEMS
from abbe.compcore.files.text.toml_source import TomlSource
from tests.support.daemon.command_line import abbe
from tests.support.daemon.shop_floor import FITTED, furnish

HOSTILE = {
    "dotted keys": ".".join("a" * 50_000) + " = 1",
    "dotted keys with blanks": " . ".join("a" * 25_000) + " = 1",
    "quoted dotted keys": ".".join(['"a"'] * 25_000) + " = 1",
    "dotted header": "[" + ".".join("a" * 50_000) + "]",
    "dotted header of an array": "[[" + ".".join("a" * 50_000) + "]]",
    "lists": "a = " + "[" * 100_000,
    "whole lists": "a = " + "[" * 50_000 + "]" * 50_000,
    "inline tables": "a = " + "{a = " * 25_000 + "1" + "}" * 25_000,
    "many keys": "".join(f"a{i}=1\n" for i in range(600_000)),
    "a long list": "a = [" + "1," * 600_000 + "]",
    "a long number": "a = " + "9" * 100_000,
    "quotes": 'a = "' + '\\"' * 500_000,
    "long quotes": 'a = """' + '\\"""' * 200_000,
    "no text": "\0" * 1_000_000,
}

COUNTED = """
import os, subprocess, sys
running = subprocess.Popen(sys.argv[2:])
_, status, used = os.wait4(running.pid, 0)
open(sys.argv[1], "w").write(str(used.ru_maxrss))
sys.exit(os.waitstatus_to_exitcode(status))
"""
"""Starts a command and writes down its memory, kB. The system counts for a process also what its
parent held when it was started, and these tests' own process may hold any amount."""


@pytest.mark.one_in(6)
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_toml_is_one_error_within_seconds(tmp_path: Path, name: str):
    """As a process of its own, whose memory the system counts."""
    path, counted = tmp_path / "hostile.toml", tmp_path / "kB"
    path.write_text(HOSTILE[name])
    begun = time.monotonic()
    command = [sys.executable, "-m", "abbe.daemon", "history", str(path)]
    running = subprocess.run(
        [sys.executable, "-c", COUNTED, str(counted), *command], capture_output=True, check=False
    )
    message = running.stderr
    assert (running.returncode, running.stdout) == (1, b"")
    assert message.startswith(f"abbe: {path}".encode())
    assert message.count(b"\n") == 1
    assert len(message) < 1000
    assert int(counted.read_text()) < 500_000
    assert time.monotonic() - begun < 30.0  # it took minutes, on any computer


def test_what_people_write_is_within_the_bounds():
    deep = "a = " + "[" * MOST_DEPTH + "]" * MOST_DEPTH
    assert TomlSource(deep).data
    assert TomlSource(".".join("a" * MOST_DEPTH) + " = 1").data
    many = f"a = [{'1,' * (MOST_ITEMS // 4)}]"
    assert len(TomlSource(many).data["a"]) == MOST_ITEMS // 4
    # dots, brackets and commas in texts and remarks are none
    text = "[" * 100 + "." * 100
    assert TomlSource(f"a = \"{text}\" # {text}\nb = '{text}'\nc = '''\n{text}'''").data


@pytest.mark.parametrize("content", [b"\xff\xfe", b'format = "\xe9"\n'])
def test_what_is_not_utf_8_is_reported_with_its_line(tmp_path: Path, content: bytes):
    path = tmp_path / "m.toml"
    path.write_bytes(b"# one\n" + content)
    with pytest.raises(InputError, match=r"m\.toml, line 2: not UTF-8 text"):
        TomlSource.read(path)


def record_of(folder: Path) -> dict[str, object]:
    return json.loads((folder / RECORD_NAME).read_text())  # type: ignore[no-any-return]


@pytest.fixture
def tables(tmp_path: Path) -> Path:
    """A set of tables with its record."""
    furnish(tmp_path)
    (tmp_path / "model.toml").write_text(FITTED)
    made = abbe("table", tmp_path / "model.toml", "--controller", "csv", "-o", tmp_path / "t")
    assert made.status == 0, made
    return tmp_path / "t"


WRONG = [
    ("controller", 3), ("controller", None), ("options", "typ=1"), ("options", [1]),
    ("files", "x.csv"), ("files", ["x.csv"]), ("files", {"x.csv": 3}), ("files", {"x.csv": "abc"}),
    ("sha256", 1), ("sha256", "0" * 63), ("tables", {}), ("tables", [3]), ("tables", [{}]),
    ("tables", [{"table": "X", "largest": "3", "unit": "um"}]),
    ("tables", [{"table": "X", "largest": float("nan"), "unit": "um"}]),
    ("conditions", []), ("conditions", {"tool_mm": "abc"}), ("conditions", {"tool_mm": [1, 2]}),
    ("conditions", {"tool_mm": [1, 2, None]}), ("model", 3), ("model", {"sha256": 5}),
    ("model", {"versions_before": "1"}), ("model", {"machine": []}), ("format", "abbe-tables/2"),
]  # fmt: skip


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("key", "value"), WRONG)
def test_wrong_types_in_a_record_are_one_error(tables: Path, key: str, value: object):
    record = record_of(tables)
    record[key] = value
    (tables / RECORD_NAME).write_text(json.dumps(record))
    with pytest.raises(InputError) as caught:
        TableSet.load(tables)
    assert caught.value.file == str(tables / RECORD_NAME)
    assert (caught.value.field or "").startswith(key)


@pytest.mark.parametrize("key", ["controller", "options", "files", "sha256", "format"])
def test_a_key_that_a_record_lacks_is_named(tables: Path, key: str):
    record = record_of(tables)
    del record[key]
    (tables / RECORD_NAME).write_text(json.dumps(record))
    with pytest.raises(InputError) as caught:
        TableSet.load(tables)
    assert caught.value.field == key


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/b", "..", "", "a\\b", "a\0b"])
def test_a_record_names_no_file_outside_its_folder(tables: Path, name: str):
    (tables.parent / "secret").write_text("x")
    record = record_of(tables)
    record["files"] = {name: sha256("x")}
    (tables / RECORD_NAME).write_text(json.dumps(record))
    with pytest.raises(InputError, match="the name of a file in the same folder") as caught:
        TableSet.load(tables)
    assert (caught.value.field or "").startswith("files")


def test_a_list_of_files_that_was_changed_is_noticed(tables: Path):
    record = record_of(tables)
    assert isinstance(record["files"], dict)
    record["files"].popitem()
    (tables / RECORD_NAME).write_text(json.dumps(record))
    with pytest.raises(InputError, match="list of files was changed"):
        TableSet.load(tables)


@pytest.mark.parametrize(
    "text", ["", "[", "[]", "3", "null", "[" * 100_000, '{"a":' * 100_000, '{"a": 1' + "0" * 9_000,
             "{" + '"a": [[]],' * 1_000_000, "\0" * 1000]
)  # fmt: skip
def test_a_record_that_is_no_json_is_one_error(tables: Path, text: str):
    (tables / RECORD_NAME).write_text(text)
    with pytest.raises(InputError) as caught:
        TableSet.load(tables)
    assert caught.value.file == str(tables / RECORD_NAME)
    assert len(str(caught.value)) < 1000
