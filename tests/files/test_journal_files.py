"""The journal of `abbe run`: on nothing else's file, and on a full disk."""

from __future__ import annotations

import logging
import subprocess
import sys
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.daemon.config import load_config
from abbe.daemon.event_log import JournalFile
from tests.support.daemon.observed import free_port

EXAMPLE = Path(__file__).parents[2] / "examples" / "bridge-cmm"
EARLIER = "2026-01-02 03:04:05,678 INFO    running: config.toml\n"


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """The example's configuration, to be changed."""
    for name in ("model.toml", "config.toml"):
        (tmp_path / name).write_bytes((EXAMPLE / name).read_bytes())
    return tmp_path / "config.toml"


def journal_at(config: Path, file: str) -> None:
    text = config.read_text(encoding="utf-8")
    start = text.index("[journal]")
    old = text[start : text.index("\n\n", start)]
    config.write_text(text.replace(old, f'[journal]\nfile = "{file}"'), encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("model.toml", "is something else than what would be written"),
        ("config.toml", "is something else than what would be written"),
        ("day1.csv", "is something else than what would be written"),
        ("link.log", "is something else than what would be written"),
        ("aside.log", "is something else than what would be written"),
        ("folder", "Is a directory"),
        ("no/journal.log", "No such file or directory"),
    ],
)
def test_a_journal_on_another_file_is_refused_at_check(config: Path, file: str, message: str):
    folder = config.parent
    (folder / "day1.csv").write_text("time,X\n0,1\n")
    (folder / "link.log").symlink_to("model.toml")
    (folder / "aside.log.1").write_text("mine\n")
    (folder / "folder").mkdir()
    journal_at(config, file)
    before = {p: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    with pytest.raises(InputError, match=message) as found:
        load_config(config)
    assert found.value.field == "journal.file"
    assert found.value.line
    assert {p: p.read_bytes() for p in folder.iterdir() if p.is_file()} == before


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("my.log", "would be written onto the journal"),
        ("model.toml", "is something else than what would be written"),
        ("day1.csv", "is something else than what would be written"),
        ("/dev/null", "must be a file"),
        ("/dev/zero", "must be a file"),
        (".", "Is a directory"),
    ],
)
def test_a_journal_of_uploads_on_another_file_is_refused_at_check(
    tmp_path: Path, file: str, message: str
):
    example = EXAMPLE.parent / "upload"
    for path in example.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "day1.csv").write_text("time,X\n0,1\n")
    [config] = [p for p in tmp_path.glob("*.toml") if "[upload]" in p.read_text(encoding="utf-8")]
    text = config.read_text(encoding="utf-8").replace(
        "[upload]\n", f'[journal]\nfile = "my.log"\n[upload]\njournal = "{file}"\n', 1
    )
    config.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message) as found:
        load_config(config)
    assert found.value.field == "upload.journal"


@pytest.mark.parametrize("content", [None, "", EARLIER, "\0" * 40 + EARLIER])
def test_a_journal_goes_on_in_an_earlier_one(config: Path, content: str | None):
    if content is not None:
        (config.parent / "my.log").write_text(content)
    journal_at(config, "my.log")
    load_config(config)


def test_a_full_disk_is_one_event_and_the_service_runs_on(config: Path):
    journal_at(config, "/dev/full")
    # another test runs the example as it stands: two must not work on one controller
    text = config.read_text("utf-8").replace("port = 5020", f"port = {free_port()}")
    config.write_text(text, "utf-8")
    command = [sys.executable, "-m", "abbe.daemon", "run", str(config), "--duration", "0.3"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "Logging error" not in done.stderr
    assert done.stderr.count("the journal cannot be written: No space left on device") == 1
    assert "ended" in done.stderr


def test_events_that_were_lost_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    handler = JournalFile(Path("/dev/full"), 1000, 2)
    record = logging.makeLogRecord({"msg": "an event", "levelno": logging.INFO})
    for _ in range(3):
        handler.emit(record)
    handler.baseFilename = str(tmp_path / "roomy.log")
    with caplog.at_level(logging.INFO, "abbe.journal"):
        handler.emit(record)
    handler.close()
    assert (tmp_path / "roomy.log").read_text() == "an event\n"
    logged = [r.getMessage() for r in caplog.records]
    assert logged[0].startswith("the journal cannot be written: No space left on device")
    assert logged[1:] == ["the journal is written again; 3 events are missing in it"]


def test_a_link_stays_when_the_journal_is_put_aside(tmp_path: Path):
    (tmp_path / "disk").mkdir()
    link = tmp_path / "my.log"
    link.symlink_to("disk/my.log")
    handler = JournalFile(link, 200, 2)
    record = logging.makeLogRecord({"msg": "m\udcff" * 40, "levelno": logging.INFO})
    for _ in range(5):
        handler.emit(record)
    handler.close()
    assert link.is_symlink()
    names = sorted(p.name for p in (tmp_path / "disk").iterdir())
    assert names == ["my.log", "my.log.1", "my.log.2"]
