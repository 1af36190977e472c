"""``abbe uncertainty`` as it is typed: figures, the page, the table form, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from abbe.compcore.effects import Scale
from abbe.compcore.files.model_file import save_model
from tests.support.compcore.unsure_machines import MACHINE, unsure
from tests.support.daemon.command_line import abbe

HEAD = """format = "abbe-part/1"
name = "Block"
[probe]
repeatability = 0.5
"""
LEFT = """[[features]]
name = "left"
kind = "point"
at = [100, 300, 0]
axis = [-1, 0, 0]
"""
RIGHT = """[[features]]
name = "right"
kind = "point"
at = [500, 300, 0]
axis = [1, 0, 0]
"""
LENGTH = """[[characteristics]]
name = "L"
what = "distance"
of = ["left", "right"]
tolerance = 40
"""
TABLE = """# format = "abbe-part/1"
# [probe]
# repeatability = 0.5
feature,kind,x,y,z,nx,ny,nz
left,point,100,300,0,-1,0,0
right,point,500,300,0,1,0,0
"""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    effect = Scale(axis="X")
    (name,) = [p.name for p in effect.linear(MACHINE)]
    path = tmp_path / "model.toml"
    save_model(unsure((effect, {name: (50e-6, 4e-6)})), path)
    return path


def run(model: Path, text: str, *more: object, name: str = "part.toml"):
    part = model.parent / name
    part.write_text(text, encoding="utf-8")
    return abbe("uncertainty", model, part, "--workers", 1, "--draws", 1000, *more)


def test_the_figures_and_what_would_lower_them(model: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    done = run(model, HEAD + LEFT + RIGHT + LENGTH, "--json", "--report", page)
    assert done.status == 0, done.err
    found = json.loads(done.out)
    (length,) = found["characteristics"]
    expected = (1.6**2 + 2 * 0.5**2) ** 0.5
    assert length["nominal"] == 400.0
    assert length["linear_sd"] == pytest.approx(expected, rel=1e-3)
    assert length["corrected"]["sd"] == pytest.approx(expected, rel=0.12)
    assert length["uncorrected"]["bias"] == pytest.approx(-20.0, abs=0.4)
    assert length["of_tolerance"] == pytest.approx(1.96 * expected / 40.0, rel=0.15)
    best = found["measure_next"][0]
    assert best["instrument"] == "laser"
    after = best["expanded_uncertainty"]["L"]
    assert after["after"] < 0.7 * after["before"]  # the scale is what is unsure, and lasers see it
    text = page.read_text(encoding="utf-8")
    assert "Uncertainty of a part program" in text
    assert "scale axis=X" in text


def test_text_says_what_it_is(model: Path) -> None:
    done = run(model, HEAD + LEFT + RIGHT + LENGTH, "--instruments", "none")
    assert done.status == 0, done.err
    assert "measured − true, 1000 virtual measurements, 95 %" in done.out
    row = next(line for line in done.out.splitlines() if line.startswith("L "))
    assert row.split()[1:3] == ["400.0000", "mm"]


def test_a_table_of_points_is_the_same_program(model: Path) -> None:
    one = json.loads(run(model, HEAD + LEFT + RIGHT, "--json").out)
    two = json.loads(run(model, TABLE, "--json", name="part.csv").out)
    assert one["characteristics"] == two["characteristics"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + LEFT + RIGHT.replace("[500", "[5000"), "does not reach it: X would stand at 5000"),
        (HEAD + LEFT + LENGTH, "line 13, field 'characteristics[0].of': no such feature"),
        (HEAD + LEFT.replace("point", "ponit"), "line 7, field 'features[0].kind'"),
        (HEAD + LEFT.replace('"point"', '"circle"'), "a circle has a diameter"),
        (HEAD.replace("repeatability", "repeatibility") + LEFT, "field 'probe.repeatibility'"),
        (HEAD + "[signals]\nT_q = 20\n" + LEFT + RIGHT, "knows no such signal"),
        (HEAD + LEFT + LEFT, "a name twice"),
        (HEAD + LEFT, "nothing is evaluated"),
        (HEAD.replace("part/1", "part/9") + LEFT, "line 1, field 'format'"),
        (HEAD + LEFT.replace("[100, 300, 0]", "[nan, 300, 0]"), "field 'features[0].at"),
        (HEAD + LEFT.replace("[-1, 0, 0]", "[0, 0, 0]") + RIGHT, "not a direction"),
        ("format = [", "not valid TOML"),
        (TABLE.replace("500,300", "5e2,drei"), "line 6, field 'y': not a number"),
        (TABLE.replace(",nz", ""), "line 4, field 'nz': a column is missing"),
        (TABLE.replace("right,point", "right,plane"), "too few points of a plane"),
        (TABLE.replace("1,0,0\n", "1,0\n"), "not a cell for each column"),
        (TABLE.splitlines()[0] + "\n", "format"),
        (TABLE.replace('# format = "abbe-part/1"\n', ""), "the head lacks its format"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(model: Path, text: str, words: str) -> None:
    done = run(model, text)
    assert done.status == 1
    assert done.out == ""
    assert done.err.count("\n") == 1, done.err
    assert words in done.err


def test_a_model_without_covariance_is_refused(model: Path) -> None:
    text = model.read_text(encoding="utf-8")
    start = text.index("[covariance") if "[covariance" in text else text.index("covariance")
    assert start > 0
    bare = text[:start]
    model.write_text(bare, encoding="utf-8")
    done = run(model, HEAD + LEFT + RIGHT)
    assert done.status == 1
    assert "covariance" in done.err


def test_options_that_do_not_go_together(model: Path) -> None:
    for more, words in (
        (("--scheduler", "tcp://127.0.0.1:1"), "--scheduler or --workers"),
        (("--tls-ca", "x.pem"), "belongs to --scheduler"),
    ):
        assert words in run(model, HEAD + LEFT + RIGHT, *more).err
