"""Units and signs at the door: a campaign whose values or temperatures are another's unit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe

DATA = Path(__file__).parents[3] / "data" / "p02-bridge"
"""A model that lacks nothing: every suspicion here is of what was done to its campaigns."""
MODEL, FIT, CHECK = DATA / "model.toml", DATA / "fit.csv", DATA / "check.csv"


def changed(path, out, change, *columns, rows=lambda row: True):
    """A campaign with the numbers of some columns changed, as a person's spreadsheet would."""
    lines = path.read_text(encoding="utf-8").splitlines()
    top = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    names = lines[top].split(",")
    for i in range(top + 1, len(lines)):
        cells = lines[i].split(",")
        if rows(dict(zip(names, cells, strict=True))):
            for column in columns:
                k = names.index(column)
                cells[k] = f"{change(float(cells[k])):.6f}"
        lines[i] = ",".join(cells)
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return out


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    out = tmp_path_factory.mktemp("fitted") / "fitted.toml"
    assert abbe("fit", MODEL, FIT, "-o", out).status == 0
    return out


def suspicions(*command):
    done = abbe(*command, "--json")
    assert done.status == 0, done.err
    return json.loads(done.out)["suspicions"]


def test_sound_campaigns_are_not_suspected(fitted, tmp_path):
    assert suspicions("compare", fitted, CHECK) == []
    assert suspicions("fit", MODEL, FIT, "-o", tmp_path / "f.toml") == []
    assert suspicions("fit", fitted, CHECK, "-o", tmp_path / "g.toml") == []
    assert "SUSPICIOUS" not in abbe("compare", fitted, CHECK).out


def test_values_in_mm(fitted, tmp_path):
    """20 µm written as 0.020: all residuals of a new fit would be 0.00 µm."""
    of_lengths = {"rows": lambda row: row["kind"] == "displacement"}
    wrong = changed(FIT, tmp_path / "mm.csv", lambda v: v / 1e3, "value", **of_lengths)
    raised = suspicions("fit", MODEL, wrong, "-o", tmp_path / "f.toml")
    assert any("displacements vary by 0.0" in s and "were they written in mm" in s for s in raised)
    raised = suspicions("compare", fitted, wrong)
    assert any("1/1000: were mm written where µm belong" in s for s in raised)
    assert "SUSPICIOUS: " in abbe("compare", fitted, wrong).out


def test_values_and_uncertainties_that_leave_nothing(tmp_path):
    """sd a thousand times too large: χ²/dof 1e-6 is no praise."""
    wrong = changed(FIT, tmp_path / "sd.csv", lambda v: 30.0 * v, "sd")
    raised = suspicions("fit", MODEL, wrong, "-o", tmp_path / "f.toml")
    (one,) = [s for s in raised if s.startswith("χ²/dof")]
    assert "0.001" in one
    assert "times less is left than the stated uncertainties say" in one


def test_each_kind_of_rows_is_named_where_it_is_doubted(fitted, tmp_path):
    """Lengths and rotations are judged apart: two lines that say the same would help nobody."""
    wrong = changed(FIT, tmp_path / "sd.csv", lambda v: 30.0 * v, "sd")
    raised = [s for s in suspicions("compare", fitted, wrong) if s.startswith("χ²/dof")]
    assert [s.split(" is ")[0] for s in raised] == ["χ²/dof of lengths", "χ²/dof of rotations"]


def test_all_signs_turned(fitted, tmp_path):
    wrong = changed(CHECK, tmp_path / "turned.csv", lambda v: -v, "value")
    raised = suspicions("compare", fitted, wrong)
    assert sum("measured is the opposite of predicted" in s for s in raised) >= 1
    assert any(
        s.startswith("χ²/dof of lengths is ") and "stated uncertainties" in s for s in raised
    )
    again = suspicions("fit", fitted, wrong, "-o", tmp_path / "f.toml")
    assert any("measured is the opposite of predicted" in s for s in again)


def test_some_set_ups_turned(fitted, tmp_path):
    """One diagonal measured from its other end: only that set-up is named."""
    one = {"rows": lambda row: row["setup"] == "c0_diag0"}
    wrong = changed(CHECK, tmp_path / "one.csv", lambda v: -v, "value", **one)
    (raised,) = [s for s in suspicions("compare", fitted, wrong) if "opposite" in s]
    assert raised.endswith("in the set-up c0_diag0")


def test_degrees_fahrenheit(fitted, tmp_path):
    wrong = changed(CHECK, tmp_path / "f.csv", lambda t: 1.8 * t + 32.0, "T_x")
    raised = suspicions("compare", fitted, wrong)
    assert any("T_x reads 6" in s and "°F would be" in s for s in raised)
    place = ("correct", fitted, "X=350", "Y=450", "Z=-180")
    signals = [f"T_{n}=20" for n in ("amb", "y", "z", "col_front", "col_rear", "spindle")]
    done = abbe(*place, *signals, "T_x=68")
    assert "T_x reads 68 °C; 68 °F would be 20 °C" in done.err + done.out
    assert "T_x=68 degC is outside" in done.err + done.out
    sound = abbe(*place, *signals, "T_x=20")
    assert "°F" not in sound.err + sound.out


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1e-3, "were mm/m (mrad) written"), (0.20626481, "were arc seconds written")],
)
def test_angles_in_other_units(fitted, tmp_path, factor, words):
    rotations = {"rows": lambda row: row["kind"] == "rotation"}
    wrong = changed(FIT, tmp_path / "a.csv", lambda v: factor * v, "value", **rotations)
    assert any(words in s for s in suspicions("compare", fitted, wrong))
