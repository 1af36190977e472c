"""A sphere touched by the machine's own probe while the table turns: where the table's line is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.files.importers.rotary.probed import import_probed
from abbe.compcore.files.model_file import load_model
from tests.support.daemon.command_line import abbe

MILL = """format = "abbe-model/1"
[machine]
name = "Mill"
structure = "w C' b X Y Z t"
[machine.axes.X]
travel = [-300.0, 300.0]
[machine.axes.Y]
travel = [-300.0, 300.0]
[machine.axes.Z]
travel = [-100.0, 300.0]
[machine.axes.C]
travel = [-360.0, 360.0]
[[effects]]
kind = "rotary_location"
axis = "C"
"""
TOOL = np.array([0.0, 0.0, -120.0])
LINE = np.array([-0.010, 0.025, 0.0])
"""Where the table's line really is, mm: 10 µm towards −X and 25 µm towards +Y of its place."""
LEAN = np.array([30e-6, -20e-6])
"""About X and Y, rad: how the table's line leans."""
REACH = 14.5


def turned(c: float, lean: np.ndarray) -> np.ndarray:
    """What a table does when its C grows by `c` (rad): it turns the other way, about its line."""
    axis = np.array([lean[1], -lean[0], 1.0])
    axis /= np.linalg.norm(axis)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) - np.sin(c) * k + (1.0 - np.cos(c)) * (k @ k)


def touches(
    folder: Path, spheres: list[list[float]], line: np.ndarray, lean: np.ndarray, noise: float = 0.0
) -> list[Path]:
    """The files of spheres that a machine with straight X, Y, Z has touched."""
    rng = np.random.default_rng(7)
    ways = np.vstack([np.eye(3), -np.eye(3)[:2], np.ones((1, 3)) / np.sqrt(3.0)])
    made = []
    for number, sphere in enumerate(spheres):
        lines = ["X,Y,Z,C"]
        for angle in range(0, 360, 30):
            at = line + turned(np.radians(angle), lean) @ (np.array(sphere) - line)
            for way in ways:
                x, y, z = at + REACH * way - TOOL + rng.normal(0.0, noise, 3)
                lines.append(f"{x:.6f},{y:.6f},{z:.6f},{angle}.000000")
        made.append(folder / f"s{number}.csv")
        made[-1].write_text("\n".join(lines) + "\n", encoding="utf-8")
    return made


def test_the_tables_line_is_found_with_its_sign(tmp_path: Path) -> None:
    """By hand: a line 10 µm towards −X of its place is E_X0C = +10 µm (docs of the effect)."""
    model = tmp_path / "mill.toml"
    model.write_text(MILL, encoding="utf-8")
    files = touches(tmp_path, [[110.0, 20.0, 60.0], [80.0, -60.0, 150.0]], LINE, LEAN, 3e-4)
    campaigns = []
    for file in files:
        campaigns.append(file.with_suffix(".campaign.csv"))
        done = abbe("import-campaign", file, "--as", "probed", "--model", model,
                    "--tool", "0,0,-120", "--sd", "0.5", "-o", campaigns[-1])  # fmt: skip
        assert done.status == 0, done.err
        assert "72 touches" in campaigns[-1].read_text("utf-8")
    fitted = tmp_path / "fitted.toml"
    assert abbe("fit", model, *campaigns, "-o", fitted).status == 0
    (term,) = load_model(fitted).terms
    found = term.values
    wanted = {"E_X0C": 0.010, "E_Y0C": -0.025, "E_A0C": -30e-6, "E_B0C": 20e-6}
    for name, value in wanted.items():
        assert found[name].value == pytest.approx(value, abs=4.0 * found[name].sd), name
        assert found[name].sd < (0.5e-3 if name[2] in "XY" else 3e-6)


def test_touches_that_are_no_sphere_are_refused(tmp_path: Path) -> None:
    model = tmp_path / "mill.toml"
    model.write_text(MILL, encoding="utf-8")
    machine = load_model(model).machine
    (file,) = touches(tmp_path, [[110.0, 20.0, 60.0]], LINE, LEAN)
    good = file.read_text("utf-8").splitlines()
    assert import_probed(file, machine, ForeignPlacing(tool=(0.0, 0.0, -120.0))).n == 36
    for lines, words in (
        (good[:-2], "4 points; a sphere takes 5"),
        ([*good[:3], "1" + good[3], *good[4:]], "not on one sphere|not believable"),
        ([good[0].replace("C", "Q"), *good[1:]], "not the touches"),
    ):
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        with pytest.raises(InputError, match=words):
            import_probed(file, machine)
