"""The errors of a volume against closed forms, and the picture against the errors."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.figures.residuals import fills_a_volume
from abbe.compcore.figures.volume import enlargement, volume
from abbe.compcore.files.model_file import load_model
from abbe.compcore.model.error_volume import error_volume

SQUARENESS = 40e-6
ALPHA = 1e-5
MODEL = f"""
format = "abbe-model/1"
[machine]
name = "small"
structure = "w b Y X Z t"
reference_temperature = 20.0
[machine.axes.X]
travel = [0.0, 400.0]
[machine.axes.Y]
travel = [-100.0, 500.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[machine.signals.T]
unit = "degC"
role = "scale"
axis = "X"
[[effects]]
kind = "squareness"
axes = ["Y", "X"]
[effects.parameters.angle]
value = {SQUARENESS}
unit = "rad"
[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T"]
[effects.parameters.alpha]
value = {ALPHA}
unit = "1/K"
"""


@pytest.fixture
def model(tmp_path: Path):
    path = tmp_path / "m.toml"
    path.write_text(MODEL)
    return load_model(path)


def test_closed_forms_at_every_node_and_on_every_line(model) -> None:
    found = error_volume(model, {}, signals={"T": 23.0}, tool=(0.0, 0.0, -50.0))
    assert found.axes == ("X", "Y", "Z")
    assert found.nodes.shape == (125, 3)
    for place, error in (
        (found.nodes, found.error),
        (found.lines.reshape(-1, 3), found.line_error.reshape(-1, 3)),
    ):
        x = place[:, 0]
        # the bridge is turned about Z: what stands at X moves along Y by X times the angle
        true = np.stack([ALPHA * 3.0 * x, SQUARENESS * x, np.zeros_like(x)], axis=1)
        assert np.abs(error - true).max() < 1e-9
    assert found.largest == pytest.approx(400.0 * np.hypot(3.0 * ALPHA, SQUARENESS))
    assert found.worst[0] == 400.0
    low, high = found.lines.reshape(-1, 3).min(axis=0), found.lines.reshape(-1, 3).max(axis=0)
    assert low.tolist() == [0.0, -100.0, -300.0]
    assert high.tolist() == [400.0, 500.0, 0.0]
    assert found.edges.sum() == 12


def test_the_picture_shows_the_errors_enlarged(model) -> None:
    found = error_volume(model, {}, signals={"T": 23.0})
    figure = volume(found)
    box, warped, arrows = figure["data"]
    larger = enlargement(found)
    ends = np.stack([arrows[k].reshape(-1, 3) for k in "xyz"], axis=2)
    drawn = ends[:, 1] - ends[:, 0]
    assert drawn / larger == pytest.approx(found.error)
    assert np.nanmax(arrows["line"]["color"]) == pytest.approx(found.largest * 1e3)
    assert f"{larger:.0f}" in warped["name"]
    assert np.nanmax(box["x"]) == 400.0
    assert np.nanmax(warped["x"]) == pytest.approx(400.0 + larger * 400.0 * 3.0 * ALPHA)


def test_of_one_axis_its_line_is_drawn_and_no_box(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    text = MODEL.replace("w b Y X Z t", "w b X t")
    for axis in "YZ":
        text = re.sub(rf"\[machine\.axes\.{axis}\]\n.*\n", "", text)
    path.write_text(re.sub(r'(?s)\[\[effects\]\]\nkind = "squareness".*?(?=\[\[effects)', "", text))
    figure = volume(error_volume(load_model(path), {}, signals={"T": 23.0}))
    assert "scene" not in figure["layout"]
    assert [trace["name"] for trace in figure["data"]] == ["in X", "in Y", "in Z"]
    in_x, in_y, _ = figure["data"]
    assert in_x["y"] == pytest.approx(1e3 * ALPHA * 3.0 * np.asarray(in_x["x"]))
    assert np.abs(in_y["y"]).max() == 0.0


def test_a_line_is_no_volume() -> None:
    line = np.zeros((5, 3))
    line[:, 1] = np.arange(5.0)
    assert not fills_a_volume(line)
    assert not fills_a_volume(line[:0])
    assert not fills_a_volume(line[:1])
    line[:, 2] = np.arange(5.0) ** 2
    assert fills_a_volume(line)


def test_no_error_is_no_division_by_nothing(model) -> None:
    found = error_volume(model.with_values([{} for _ in model.terms]), {})
    assert found.largest == 0.0
    assert np.isfinite(volume(found)["data"][1]["x"][0])


def test_a_machine_of_rotary_axes_has_no_volume(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(
        'format = "abbe-model/1"\n[machine]\nname = "table"\n'
        'structure = "w C\' b t"\n'
        "[machine.axes.C]\ntravel = [0.0, 360.0]\n"
    )
    with pytest.raises(InputError, match="no linear axis"):
        error_volume(load_model(path), {})
