"""``abbe check`` and friends: what they print, and how they fail."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import typer.testing

from abbe.daemon.application import application
from abbe.daemon.commands import NAMES, SECTIONS

EXAMPLE = Path(__file__).parents[3] / "examples" / "bridge-cmm" / "config.toml"


def abbe(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from abbe.daemon.cli import main; main()", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=60, check=False)


def test_check_says_what_would_be_linked() -> None:
    done = abbe("check", str(EXAMPLE))
    assert done.returncode == 0, done.stderr
    for words in (
        "axis Y",
        "cmm.count_Y",
        "unit 1 input 6..7, int32",
        "encoder counts_per_mm=10000 direction=-1 zero=12345678 travel=0…900",
        "signal T_z2",
        "steinhart-hart",
        "corrected X",
        "unit 1 holding 2..3",
        "X 100, Y 100, Z 100 µm",
        "24 of 24 effects fitted",
    ):
        assert words in done.stdout, words


def test_check_in_json() -> None:
    done = abbe("check", str(EXAMPLE), "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    inputs = {row["what"]: row for row in found["inputs"]}
    assert inputs["axis X"]["channel"] == "cmm.count_X"
    assert inputs["axis X"]["unit"] == "count"
    assert inputs["axis X"]["becomes"] == "mm"
    assert inputs["signal T_x1"]["becomes"] == "degC"
    outputs = {row["what"]: row for row in found["outputs"]}
    assert outputs["corrected Z"]["unit"] == "mm"
    assert found["guard"]["max_correction_um"] == {"X": 100.0, "Y": 100.0, "Z": 100.0}
    assert found["model"]["signals_needed"] == ["T_x1", "T_x2", "T_y1", "T_y2", "T_z1", "T_z2"]


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_mistake_is_one_line_and_status_1(command: str, tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    text = text.replace('"model.toml"', f'"{EXAMPLE.with_name("model.toml")}"')
    (tmp_path / "bad.toml").write_text(text.replace("count_X", "cuont_X", 1), encoding="utf-8")
    done = abbe(command, "bad.toml", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("abbe: bad.toml, line ")
    assert "field 'axes.X.source'" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_model_that_is_wrong_is_named_with_its_own_line(tmp_path: Path) -> None:
    model = EXAMPLE.with_name("model.toml").read_text(encoding="utf-8")
    (tmp_path / "model.toml").write_text(
        model.replace('kind = "squareness"', 'kind = "squarness"', 1), encoding="utf-8"
    )
    (tmp_path / "config.toml").write_bytes(EXAMPLE.read_bytes())
    done = abbe("check", "config.toml", cwd=tmp_path)
    assert done.returncode == 1
    assert "model.toml, line " in done.stderr
    assert "'squarness'" in done.stderr


def test_wrong_usage_is_status_2() -> None:
    assert abbe("run").returncode == 2
    assert abbe("demo", "--duration", "0.1").returncode == 2


def test_only_the_command_that_is_asked_for_joins_the_application() -> None:
    every = typer.testing.CliRunner().invoke(application(), ["correct", "--help"])
    for name in NAMES:
        word = name.rpartition(".")[2].replace("_", "-")
        alone = application(word)
        own = [c.name for c in alone.registered_commands]
        own += [g.name for g in alone.registered_groups]
        assert own == [word]
    one = typer.testing.CliRunner().invoke(application("correct"), ["correct", "--help"])
    assert one.output == every.output
    loaded = "import sys; from abbe.daemon.application import application; application('correct'); "
    loaded += "print(*(m for m in sys.modules if m.startswith('abbe.daemon.commands.')))"
    done = subprocess.run(
        [sys.executable, "-c", loaded], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["abbe.daemon.commands.correct"]


def test_a_word_that_is_no_command_finds_those_that_are_near() -> None:
    done = abbe("corect")
    assert done.returncode == 2
    assert "correct" in done.stderr


def test_help_lists_every_command_under_a_subject_with_its_whole_first_sentence() -> None:
    shown = typer.testing.CliRunner().invoke(application(), ["--help"], env={"COLUMNS": "120"})
    words = " ".join(shown.output.split())
    for title in SECTIONS:
        assert f"{title}:" in shown.output
    for name in NAMES:
        assert shown.output.count(f"\n  {name.rpartition('.')[2].replace('_', '-')} ") == 1, name
    assert "read positions and sensors, write corrected positions back" in words
    assert words.count("...") == 1  # that of the usage
    assert "…" not in words
