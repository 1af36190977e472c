"""A file that another command reads is answered with that command, in the same one line."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from abbe.compcore.files.recognised import recognised
from tests.compcore.files.test_importers import RTL
from tests.support.daemon.command_line import abbe

DATA = Path(__file__).parents[3] / "data"
EXAMPLE = Path(__file__).parents[4] / "examples" / "bridge-cmm"
CAMPAIGN, MODEL = DATA / "p01-mill" / "fit.csv", DATA / "p01-mill" / "model.toml"
STRUCTURE = ("--structure", "w b Y X Z t")
POINTS = "".join(
    f"{x},{y},{z},{x + 1e-4 * y},{y},{z}\n"
    for x in (0, 300, 600) for y in (0, 400, 800) for z in (-300, 0)
)  # fmt: skip
TEXTS = {
    "rtl": RTL,
    "runs.csv": "position,run,direction,deviation\n0,1,up,0\n100,1,up,3\n",
    "wide.csv": "target,1+,1-\n0,0,1\n100,3,4\n",
    "circle.csv": "angle,ccw,cw\n0,1,2\n90,2,3\n180,1,2\n270,0,1\n",
    "points.csv": f"X_off,Y_off,Z_off,X_on,Y_on,Z_on\n{POINTS}",
    "lengths.csv": "position,calibrated,x1,y1,z1,x2,y2,z2\nX,500.0002,0,0,0,499.99,0,0\n",
    "plate.csv": "placing,ball,cx,cy,cz,x,y,z\n"
    "a,1,0,0,0,1,2,3\na,2,100,0,0,101,2,3\na,3,0,100,0,1,102,3\na,4,100,100,0,101,102,3\n",
}
FILES = {
    "map.txt": DATA / "bridge-map.txt",
    "fit.csv": CAMPAIGN,
    "y.com": DATA / "controllers" / "heidenhain-tnc" / "y.com",
    "pitch.txt": DATA / "controllers" / "fanuc" / "pitch.txt",
}
COMMAND = re.compile(r"(?<=: )abbe [^;(\n]*(?=$| \(with|; )", re.MULTILINE)
LEFT_OPEN = re.compile(r"\b[A-Z]{3,}\b\.?|…|\.\.\.|<|>")
"""What stands for something that the reader would have to fill in."""


@pytest.fixture
def shop(tmp_path, monkeypatch) -> Path:
    """A folder whose name needs quotes, with all kinds of files but a model."""
    folder = tmp_path / "hall 3"
    folder.mkdir()
    monkeypatch.chdir(tmp_path)
    for name, text in TEXTS.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name, source in FILES.items():
        shutil.copy(source, folder / name)
    (folder / "running").mkdir()
    shutil.copy(EXAMPLE / "config.toml", folder / "running")
    shutil.copy(EXAMPLE / "model.toml", folder / "running")

    shutil.copy(MODEL, tmp_path / "m.toml")
    return folder


def told(*words: object) -> str:
    """The command that an error names; it is one line."""
    done = abbe(*words)
    assert done.status in (1, 2), done
    assert done.err.count("\n") == 1, done.err
    assert "this is a" in done.err, done.err
    commands = COMMAND.findall(done.err)
    assert len(commands) == 1, done.err
    return str(commands[0])


def run(command: str) -> None:
    words = shlex.split(command)
    assert not [w for w in words if LEFT_OPEN.fullmatch(w)], command
    done = abbe(*words[1:])
    assert done.status == 0, f"{command}\n{done.err}"


@pytest.mark.parametrize(
    ("typed", "answer"),
    [
        ("fit m.toml 'hall 3/rtl' -o x.toml", "import-campaign 'hall 3/rtl' --as rtl"),
        ("compare m.toml 'hall 3/runs.csv'", "import-campaign 'hall 3/runs.csv' --as"),
        ("compare m.toml 'hall 3/wide.csv'", "import-campaign 'hall 3/wide.csv' --as"),
        ("diagnose m.toml 'hall 3/circle.csv'", "--as ballbar --plane XY --centre 0,0"),
        ("fit m.toml 'hall 3/map.txt' -o x.toml", "import-map 'hall 3/map.txt' --struc"),
        ("fit 'hall 3/map.txt' 'hall 3/fit.csv' -o x.toml", "import-map 'hall 3/map.txt' --struc"),
        ("compare 'hall 3/fit.csv' m.toml", "compare m.toml 'hall 3/fit.csv'"),
        ("correct 'hall 3/fit.csv' X=1", "iso230 'hall 3/fit.csv'"),
        ("correct 'hall 3/running/config.toml' X=1", "check 'hall 3/running/config.toml'"),
        ("compare m.toml 'hall 3/points.csv'", "identify-convention 'hall 3/map.txt' 'hall 3/po"),
        ("correct 'hall 3/points.csv' X=1", "identify-convention 'hall 3/map.txt' 'hall 3/points"),
        ("run m.toml", "history m.toml"),
        ("run 'hall 3/running/model.toml'", "history 'hall 3/running/model.toml'"),
        ("check 'hall 3/fit.csv'", "iso230 'hall 3/fit.csv'"),
        ("import-map 'hall 3/fit.csv' --structure 'w b Y X Z t' -o x.toml", "iso230 'hall 3/fit.c"),
        ("import-map 'hall 3/rtl' --structure 'w b Y X Z t' -o x.toml", "--as rtl -o 'hall 3/rtl-"),
        ("import-campaign 'hall 3/fit.csv' --as rtl -o x.csv", "iso230 'hall 3/fit.csv'"),
        ("import-campaign 'hall 3/rtl' --as iso230-2 --axis X -o x.csv", "--as rtl -o 'hall 3/"),
        ("compare m.toml 'hall 3/lengths.csv'", "gauges 'hall 3/lengths.csv'"),
        ("iso230 'hall 3/plate.csv'", "gauges 'hall 3/plate.csv'"),
        ("iso230 'hall 3/y.com'", "--controller heidenhain-tnc --structure 'w b Y X Z t' --travel"),
        ("compare m.toml 'hall 3/pitch.txt'", "--controller fanuc --onto m.toml"),
    ],
)  # fmt: skip
def test_the_command_that_reads_it_is_named_whole_and_runs(shop, typed, answer):
    command = told(*shlex.split(typed))
    assert answer in command
    assert not Path("x.toml").exists()
    assert not Path("x.csv").exists()
    run(command)


def test_a_name_that_is_taken_is_not_proposed(shop):
    (shop / "rtl-campaign.csv").write_text("mine", encoding="utf-8")
    command = told("iso230", shop / "rtl")
    assert command.endswith("rtl-campaign-2.csv'")
    run(command)
    assert (shop / "rtl-campaign.csv").read_text("utf-8") == "mine"


def test_what_was_typed_and_what_lies_beside_is_taken_up(shop):
    """A structure, an axis, a model in the same folder: none of it is guessed then."""
    told_so = ("import-grid", "hall 3/map.txt", "--controller", "csv", "-o", "x.toml")
    assert "--structure 'w b X Y Z t'" in told(*told_so, "--structure=w b X Y Z t")
    run_of = ("import-campaign", "hall 3/runs.csv", "--as", "rtl", "-o", "x.csv")
    assert "--axis Z -o" in told(*run_of, "--axis", "Z")
    assert abbe(*run_of, "--axis", "Z").err.endswith("'hall 3/runs-campaign.csv'\n")
    stated = (shop / "circle.csv").read_text("utf-8")
    (shop / "circle.csv").write_text(f"# plane = YZ\n# centre = 1, 2\n{stated}", encoding="utf-8")
    command = told("fit", "m.toml", "hall 3/circle.csv", "-o", "x.toml")
    assert ("--plane" in command, "--centre" in command) == (False, False)
    said = abbe("fit", "m.toml", "hall 3/circle.csv", "-o", "x.toml").err
    assert said.endswith("(with --radius as it is at your machine)\n")
    run(command)
    shutil.copy(MODEL, shop / "mill.toml")
    command = told("check", "hall 3/fit.csv")
    assert command == "abbe compare 'hall 3/mill.toml' 'hall 3/fit.csv'"
    run(command)


def test_what_nobody_has_said_is_named(shop):
    said = abbe("iso230", shop / "y.com").err
    assert said.endswith("(with --structure and --travel as it is at your machine)\n")
    (shop / "map.txt").unlink()
    said = abbe("iso230", shop / "points.csv").err
    assert said.endswith("abbe identify-convention reads it, beside a map or a fitted model\n")
    (shop / "rtest.csv").write_text("B,C,dX,dY,dZ\n0,0,1,2,3\n", encoding="utf-8")
    said = abbe("iso230", shop / "rtest.csv").err
    assert "abbe iso10791 reads it, beside a model of the machine (abbe new makes one)" in said


def test_a_name_with_a_line_end_stays_one_line(shop):
    strange = shop / "run\ns.csv"
    strange.write_text(TEXTS["runs.csv"], encoding="utf-8")
    done = abbe("compare", MODEL, strange)
    assert done.err.count("\n") == 1
    assert "this is a table of runs and directions (ISO 230-2)" in done.err


def test_a_flaw_of_the_right_file_is_reported_without_it(tmp_path):
    """A campaign with a bad row, a model with a bad key: the message is about the flaw alone."""
    lines = CAMPAIGN.read_text(encoding="utf-8").splitlines()
    bad = tmp_path / "bad.csv"
    bad.write_text("\n".join([*lines, lines[-1].replace(",-1,", ",one,", 1)]), encoding="utf-8")
    done = abbe("compare", MODEL, bad)
    assert done.status == 1
    assert "this is" not in done.err
    model = tmp_path / "bad.toml"
    model.write_text(MODEL.read_text(encoding="utf-8") + "\n[[effects]\n", encoding="utf-8")
    done = abbe("compare", model, CAMPAIGN)
    assert done.status == 1
    assert "this is" not in done.err


def test_what_ships_is_recognised(shop):
    found = {name: recognised(shop / name) for name in (*TEXTS, *FILES, "running/config.toml")}
    assert all(found.values()), [name for name, kind in found.items() if kind is None]
    assert recognised(DATA / "README.md") is None
    assert recognised(DATA) is None
