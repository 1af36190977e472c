"""Errors that others measured: grids and tables as an effect, against SciPy."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.catalogue.error_grid import ErrorGrid, MeasuredTable
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaigns
from abbe.compcore.files.grid_file import checksum, format_grid
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import FUNCTIONAL_POINT, ErrorMotion
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term

NODES = (
    np.array([0.0, 120.0, 300.0, 310.0, 500.0]),
    np.array([0.0, 200.0, 400.0]),
    np.array([-300.0, -100.0, 0.0]),
)
BRIDGE = Machine(
    "bridge",
    Structure.parse("w b Y X Z t"),
    {"X": Axis("X", (0.0, 500.0)), "Y": Axis("Y", (0.0, 400.0)), "Z": Axis("Z", (-300.0, 0.0))},
    {"T": Signal("T", role="scale", axis="X")},
)
HEAD = Machine(
    "head",
    Structure.parse("w b X Y Z C B t"),
    {
        **BRIDGE.axes,
        "C": Axis("C", (-math.pi, math.pi)),
        "B": Axis("B", (-2.0, 2.0)),
    },
)


def measured(seed: int = 1) -> tuple[np.ndarray, tuple[MeasuredTable, ...]]:
    """Random errors, up to 20 µm and 50 µrad, at every point of the grid: nothing separable."""
    rng = np.random.default_rng(seed)
    shape = tuple(map(len, NODES))
    values = (
        rng.uniform(-1.0, 1.0, (6, *shape)) * np.array([0.02] * 3 + [5e-5] * 3)[:, None, None, None]
    )
    tables = tuple(
        MeasuredTable(ErrorMotion(FUNCTIONAL_POINT, c), ("X", "Y", "Z"), NODES, values[k])
        for k, c in enumerate("XYZABC")
    )
    return values, tables


def grid_of(tables, tool=(0.0, 0.0, 0.0), name="m.grid.json") -> ErrorGrid:
    text = format_grid(tables, {})
    return ErrorGrid(file=name, tool=tool).holding(tables, checksum(text), text)


def rows(machine: Machine, n: int = 200, seed: int = 3) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {a: rng.uniform(*x.travel, n) for a, x in machine.axes.items()}


def looked_up(values: np.ndarray, q) -> np.ndarray:
    """SciPy's trilinear interpolation, (n, 6)."""
    at = np.stack([q["X"], q["Y"], q["Z"]], axis=1)
    return np.stack([RegularGridInterpolator(NODES, v)(at) for v in values], axis=1)


def test_a_grid_is_trilinear_and_its_turns_move_a_longer_tool():
    values, tables = measured()
    tool, longer = np.array([5.0, 0.0, -120.0]), np.array([40.0, -10.0, -250.0])
    model = Model(BRIDGE, (Term(grid_of(tables, tuple(tool))),))
    q = rows(BRIDGE)
    truth = looked_up(values, q)
    found = model.predict(Conditions.at(q, tool=tool))
    np.testing.assert_allclose(found.translation, truth[:, :3], atol=1e-15)
    np.testing.assert_allclose(found.rotation, truth[:, 3:], atol=1e-18)
    found = model.predict(Conditions.at(q, tool=longer))
    moved = truth[:, :3] + np.cross(truth[:, 3:], longer - tool)
    np.testing.assert_allclose(found.translation, moved, atol=1e-14)


def test_on_a_head_the_tool_stands_as_the_head_does():
    values, tables = measured()
    tool, longer = np.array([0.0, 0.0, -100.0]), np.array([3.0, 4.0, -180.0])
    model = Model(HEAD, (Term(grid_of(tables, tuple(tool))),))
    q = rows(HEAD)
    truth = looked_up(values, q)
    cb, sb, cc, sc = np.cos(q["B"]), np.sin(q["B"]), np.cos(q["C"]), np.sin(q["C"])

    def turned(v):  # Rz(C)·Ry(B)·v, written out
        x, y, z = cb * v[0] + sb * v[2], v[1] + 0.0 * cb, -sb * v[0] + cb * v[2]
        return np.stack([cc * x - sc * y, sc * x + cc * y, z], axis=1)

    found = model.predict(Conditions.at(q, tool=longer))
    moved = truth[:, :3] + np.cross(truth[:, 3:], turned(longer - tool))
    np.testing.assert_allclose(found.translation, moved, atol=1e-13)
    np.testing.assert_allclose(found.rotation, truth[:, 3:], atol=1e-17)


@pytest.mark.parametrize("machine", [BRIDGE, HEAD], ids=["bridge", "head"])
def test_the_live_path_says_the_same(machine):
    _, tables = measured()
    model = Model(machine, (Term(grid_of(tables, (0.0, 0.0, -100.0))),))
    compensator = Compensator(model, tool=(10.0, 0.0, -150.0))
    q = rows(machine, 60)
    truth = model.axis_error(Conditions.at(q, tool=(10.0, 0.0, -150.0)))
    at = np.stack([q[a] for a in compensator.axes], axis=1)
    expected = np.stack([truth[a] for a in "XYZ"], axis=1)
    assert np.abs(compensator.errors(at) - expected).max() < 1e-12
    steps = np.array([compensator.step(p, [0.0] * len(p)) for p in at.tolist()])
    assert np.abs(steps - expected).max() < 1e-12


def test_tables_of_error_motions_have_levers_directions_and_are_folded():
    nodes = (np.array([0.0, 200.0, 400.0]),)
    up, down = np.array([0.0, 4e-5, 1e-5]), np.array([1e-5, 5e-5, 0.0])
    model = Model(
        BRIDGE,
        (Term(grid_of((MeasuredTable(ErrorMotion("Y", "C"), ("Y",), nodes, up, down),))),),
    )
    compensator = Compensator(model, tool=(0.0, 20.0, 0.0))
    assert not compensator.direct_effects
    # a turn about Z of the bridge at Y = 100: 20 µrad up, 30 µrad down; lever (X, 20)
    for direction, angle in ((1.0, 2e-5), (-1.0, 3e-5), (0.0, 2.5e-5)):
        step = compensator.step([100.0, 300.0, -50.0], [direction, 0.0, 0.0])
        assert step == pytest.approx((-angle * 20.0, angle * 300.0, 0.0), abs=1e-12)


def test_a_fit_finds_what_the_grid_leaves_and_leaves_the_grid_alone(tmp_path: Path):
    values, tables = measured()
    grid = Term(grid_of(tables))
    left = make_effect("scale_expansion", {"axis": "X", "signals": ["T"]})
    model = Model(BRIDGE, (grid, Term(left)))
    n, alpha = 400, 1.15e-5
    q = rows(BRIDGE, n)
    warm = np.linspace(20.0, 27.0, n)
    rng = np.random.default_rng(5)
    value = looked_up(values, q)[:, 0] + alpha * (warm - 20.0) * q["X"]
    value += 2e-4 * rng.normal(size=n)
    text = [
        '# format = "abbe-campaign/1"',
        "# [setups.x]",
        "# free = []",
        "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd,T",
    ]
    text += [
        f"{i},x,displacement,{x!r},{y!r},{z!r},1,0,0,{1e3 * v!r},0.2,{t!r}"
        for i, (x, y, z, v, t) in enumerate(
            zip(
                q["X"].tolist(),
                q["Y"].tolist(),
                q["Z"].tolist(),
                value.tolist(),
                warm.tolist(),
                strict=True,
            )
        )
    ]
    (tmp_path / "c.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
    campaign = read_campaigns([tmp_path / "c.csv"], BRIDGE)
    result = fit(model, campaign)
    found = result.model.terms[1].values["alpha"]
    assert abs(found.value - alpha) < 4.0 * found.sd
    assert found.sd < 1e-7
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.2)
    assert result.model.terms[0] == grid
    assert result.model.covariance.shape == (1, 1)
    alone = fit(Model(BRIDGE, (grid,)), campaign)
    np.testing.assert_allclose(alone.residual, value - looked_up(values, q)[:, 0], atol=1e-15)


def test_the_model_takes_its_grid_along(tmp_path: Path):
    _, tables = measured()
    model = Model(BRIDGE, (Term(grid_of(tables)),))
    one, two = tmp_path / "a" / "m.toml", tmp_path / "b" / "n.toml"
    for path in (one, two):
        path.parent.mkdir()
    save_model(model, one)
    save_model(load_model(one), two)
    q = rows(BRIDGE, 20)
    for path in (one, two):
        again = load_model(path)
        assert again == model
        found = again.predict(Conditions.at(q)).translation
        np.testing.assert_array_equal(found, model.predict(Conditions.at(q)).translation)


def test_another_file_in_its_place_is_neither_used_nor_overwritten(tmp_path: Path):
    _, tables = measured()
    model = Model(BRIDGE, (Term(grid_of(tables)),))
    path, data = tmp_path / "m.toml", tmp_path / "m.grid.json"
    save_model(model, path)
    other = format_grid(measured(9)[1], {})
    data.write_text(other, encoding="utf-8")
    with pytest.raises(InputError, match="not the one that the model was made with"):
        load_model(path)
    before = path.read_text(encoding="utf-8")
    with pytest.raises(InputError, match="another file where the model's grid belongs"):
        save_model(replace(model, fit={"date": "2026"}), path)
    assert data.read_text(encoding="utf-8") == other
    assert path.read_text(encoding="utf-8") == before
    data.unlink()
    with pytest.raises(InputError, match="no such file"):
        load_model(path)


@pytest.mark.parametrize("name", ["../x.json", "/etc/passwd", "a/../../x", "", "c:x", "a\nb"])
def test_a_grid_lies_in_the_models_folder(name):
    with pytest.raises(InputError):
        make_effect("error_grid", {"file": name})


BAD = {
    "no numbers": (["tables", 0, "values", 0], float("nan")),
    "text": (["tables", 0, "values", 0], "1"),
    "too few": (["tables", 0, "values"], [0.0]),
    "metres": (["tables", 0, "values", 3], 1e4),
    "not rising": (["tables", 0, "nodes", 0], [0.0, 0.0, 1.0, 2.0, 3.0]),
    "far away": (["tables", 0, "nodes", 0], [0.0, 1.0, 2.0, 3.0, 1e9]),
    "no such axis": (["tables", 0, "axes", 0], "W"),
    "axis twice": (["tables", 0, "axes", 0], "Y"),
    "no letter": (["tables", 0, "axes", 0], "Q"),
    "no such place": (["tables", 0, "place"], "B"),
    "no tables": (["tables"], []),
    "another format": (["format"], "abbe-error-grid/9"),
    "unknown key": (["tables", 0, "scale"], 2.0),
}


@pytest.mark.parametrize("fault", BAD)
def test_damaged_data_are_refused(fault, tmp_path: Path):
    _, tables = measured()
    model = Model(BRIDGE, (Term(grid_of(tables)),))
    path, data = tmp_path / "m.toml", tmp_path / "m.grid.json"
    save_model(model, path)
    content = json.loads(data.read_text(encoding="utf-8"))
    keys, value = BAD[fault]
    part = content
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    text = json.dumps(content)
    data.write_text(text, encoding="utf-8")
    old, new = model.effects[0].sha256, checksum(text)
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(InputError):
        load_model(path)
