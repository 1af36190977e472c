"""What ``abbe check`` remarks, and that it remarks nothing on the example."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from abbe.daemon.config import load_config
from abbe.daemon.config.notes import notes
from tests.support.daemon.command_line import abbe

EXAMPLE = Path(__file__).parents[3] / "examples" / "bridge-cmm"


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    text = (EXAMPLE / "config.toml").read_text(encoding="utf-8")
    for old, new in (('"model.toml"', f'"{EXAMPLE / "model.toml"}"'), *changes):
        assert old in text, old
        text = text.replace(old, new, 1)
    config = folder / "config.toml"
    config.write_text(text, encoding="utf-8")
    return config


def test_the_example_leaves_nothing_to_remark() -> None:
    assert notes(load_config(EXAMPLE / "config.toml")) == []


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        ('heartbeat = "cmm.heartbeat"', "", "controller.heartbeat is not set"),
        ("require = 4 ", "require = 0 ", "controller.status with require is not set"),
        ('status = "cmm.abbe_status"', "", "output.status is not set"),
        ('heartbeat = "cmm.abbe_heartbeat"', "", "output.heartbeat is not set"),
        ('file = "journal.log"', "", "journal.file is not set"),
        ("stale_after = 0.3 ", "stale_after = 0.1 ", "longer than guard.stale_after = 0.1 s"),
    ],
)
def test_each_remark(tmp_path: Path, old: str, new: str, note: str) -> None:
    config = written(tmp_path, (old, new))
    found = notes(load_config(config))
    assert len(found) == 1
    assert note in found[0]


def test_check_prints_them_and_is_content(tmp_path: Path) -> None:
    config = written(tmp_path, ('heartbeat = "cmm.abbe_heartbeat"', ""))
    done = abbe("check", config)
    assert done.status == 0
    assert "Note: output.heartbeat is not set" in done.out
    assert done.out.rstrip().endswith("The configuration is in order.")
    (note,) = json.loads(abbe("check", config, "--json").out)["notes"]
    assert note.startswith("output.heartbeat")
