"""The campaign: the file's format, the same for the same seed, and enough to know the machine."""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline

from abbe.drivers.simulated.__main__ import main
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TOOL, TRAVELS, make_bridge
from abbe.drivers.simulated.bridge.measure import campaign

Rows = list[dict[str, str]]


def parse(text: str) -> tuple[dict[str, Any], Rows]:
    lines = text.splitlines()
    top = [line for line in lines if line.startswith("#")]
    meta = tomllib.loads("\n".join(line[2:] for line in top))
    return meta, list(csv.DictReader(io.StringIO("\n".join(lines[len(top) :]))))


def numbers(rows: Rows, names: Sequence[str]) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in rows])


FIT = campaign(1, "fit")
CHECK = campaign(1, "check")


@pytest.mark.parametrize("text", [FIT, CHECK], ids=["fit", "check"])
def test_the_file_is_in_the_campaign_format(text: str) -> None:
    meta, rows = parse(text)
    assert meta["format"] == "abbe-campaign/1"
    assert {"machine", "instrument", "notes", "setups"} <= set(meta)
    expected = ["time", "setup", "kind", "X", "Y", "Z", "X_dir", "Y_dir", "Z_dir"]
    expected += ["tool_x", "tool_y", "tool_z", "ux", "uy", "uz", "value", "sd", *PLACES]
    assert list(rows[0]) == expected
    assert {row["setup"] for row in rows} == set(meta["setups"])
    assert all(set(s["free"]) <= {"zero", "slope"} for s in meta["setups"].values())
    u = numbers(rows, ["ux", "uy", "uz"])
    assert np.linalg.norm(u, axis=1) == pytest.approx(np.ones(len(rows)), abs=1e-9)
    p = numbers(rows, AXES)
    low, high = np.array([TRAVELS[a] for a in AXES]).T
    assert np.all((p >= low) & (p <= high))
    time = numbers(rows, ["time"])[:, 0]
    assert time[0] == 0.0
    assert np.all(np.diff(time) > 0)


def test_the_same_seed_gives_the_same_file_and_another_another() -> None:
    assert campaign(1, "fit") == FIT
    assert parse(campaign(2, "fit"))[1][500]["value"] != parse(FIT)[1][500]["value"]
    with pytest.raises(ValueError, match="'other'; expected one of fit, check"):
        campaign(1, "other")  # type: ignore[arg-type]


def test_it_is_sampled_as_zhang_did_and_richer() -> None:
    meta, rows = parse(FIT)
    for axis, step in (("X", 50.0), ("Y", 50.0), ("Z", 20.0)):
        own = [row for row in rows if row["setup"] == f"{axis.lower()}_pos_1"]
        p = numbers(own, [axis])[:, 0]
        assert sorted(set(np.abs(np.diff(p))) - {0.0}) == [step]
        assert {row[f"{axis}_dir"] for row in own} == {"1", "-1"}
        assert p.min() == TRAVELS[axis][0]
        assert p.max() == TRAVELS[axis][1]
        rotations = {row["setup"] for row in rows if row["setup"].startswith(f"{axis.lower()}_rot")}
        assert len(rotations) == 6
        assert all(meta["setups"][s]["free"] == ["zero"] for s in rotations)
    scales = numbers(rows, PLACES[:6])
    assert scales.min() < 18.95
    assert scales.max() > 21.05
    assert len({row["setup"] for row in rows if row["setup"].startswith("diagonal")}) == 12
    check_meta, check_rows = parse(CHECK)
    assert len(check_meta["setups"]) == 50
    assert len({row["tool_x"] + row["tool_y"] for row in check_rows}) > 40


# An independent fit: Zhang's equations written out, B-splines from SciPy, plain least squares.


def design(rows: Rows) -> np.ndarray:
    """Columns of 18 spline motions, 3 squarenesses, 3 expansions; values in µm or µrad."""
    p = numbers(rows, AXES).T
    X, Z = p[0], p[2]
    tool = numbers(rows, ["tool_x", "tool_y", "tool_z"])
    u = numbers(rows, ["ux", "uy", "uz"])
    rotating = np.array([row["kind"] == "rotation" for row in rows])
    warm = [numbers(rows, PLACES[2 * i : 2 * i + 2]).mean(axis=1) - 20.0 for i in range(3)]
    zero = np.zeros_like(X)
    # What each carriage carries, from its own frame to the probe tip.
    arms = {
        "X": np.stack([zero, zero, Z], 1) + tool,
        "Y": np.stack([X, zero, Z], 1) + tool,
        "Z": tool,
    }

    def seen(direction: int, arm: np.ndarray | None) -> np.ndarray:
        e = np.broadcast_to(np.eye(3)[direction], u.shape)
        if arm is None:  # a translation, µm
            return np.where(rotating, 0.0, (e * u).sum(1))
        moved = (np.cross(e, arm) * u).sum(1) * 1e-3  # µrad × mm = 1e-3 µm
        return np.where(rotating, (e * u).sum(1), moved)

    columns = []
    for own, axis in enumerate(AXES):
        low, high = TRAVELS[axis]
        knots = np.concatenate([[low] * 3, np.linspace(low, high, 10), [high] * 3])
        basis = BSpline.design_matrix(np.clip(p[own], low, high), knots, 3).toarray()
        for direction in range(3):
            columns += [basis * seen(direction, None)[:, None]]
            columns += [basis * seen(direction, arms[axis])[:, None]]
        growth = p[own] * warm[own] * 1e-3  # ppm/K × mm × K = 1e-3 µm
        columns.append((growth * seen(own, None))[:, None])
    columns.append(seen(2, arms["Y"])[:, None])
    columns.append(seen(1, arms["X"])[:, None])
    columns.append(seen(0, arms["X"])[:, None])
    return np.concatenate(columns, axis=1)


def nuisances(meta: dict[str, Any], rows: Rows) -> np.ndarray:
    columns = []
    p = numbers(rows, AXES)
    names = np.array([row["setup"] for row in rows])
    for name, setup in meta["setups"].items():
        mine = names == name
        if "zero" in setup["free"]:
            columns.append(mine.astype(float))
        if "slope" in setup["free"]:
            way = np.linalg.norm(p - p[np.argmax(mine)], axis=1) * 1e-3
            columns.append(np.where(mine, way, 0.0))
    return np.stack(columns, axis=1)


def test_the_campaign_determines_the_machine_everywhere() -> None:
    meta, rows = parse(FIT)
    value, sd = numbers(rows, ["value", "sd"]).T
    matrix = np.hstack([design(rows), nuisances(meta, rows)])
    size = np.linalg.norm(matrix / sd[:, None], axis=0)
    weighted = matrix / sd[:, None] / np.where(size > 0, size, 1.0)
    solution, _, rank, _ = np.linalg.lstsq(weighted, value / sd, rcond=1e-6)
    residual = value / sd - weighted @ solution
    # As small as the noise: nothing in the file that the model of 18 + 3 + 3 lacks.
    assert 0.9 < float(residual @ residual) / (len(rows) - rank) < 1.1
    solution /= np.where(size > 0, size, 1.0)

    # Against the exact simulator, absolutely, at places, probes and temperatures never measured.
    machine = make_bridge(1)
    rng = np.random.default_rng(5)
    low, high = np.array([TRAVELS[a] for a in AXES]).T
    places = np.concatenate([rng.uniform(low, high, (400, 3)), [low, high]])
    temperatures = 20.0 + rng.uniform(-1.0, 1.2, (len(places), 1)) + rng.normal(0, 0.1, 7)
    for tool in (TOOL, (80.0, -60.0, -200.0)):
        truth = machine.error(places, temperatures, tool) * 1e3
        predicted = np.empty_like(truth)
        for i in range(3):
            shown = temperatures + machine.sensor_errors
            asked = [
                dict(zip(AXES, map(str, q), strict=True))
                | dict(zip(("tool_x", "tool_y", "tool_z"), map(str, tool), strict=True))
                | dict(zip(("ux", "uy", "uz"), map(str, np.eye(3)[i]), strict=True))
                | dict(zip(PLACES, map(str, t), strict=True))
                | {"kind": "displacement"}
                for q, t in zip(places.tolist(), shown.tolist(), strict=True)
            ]
            columns = design(asked)
            predicted[:, i] = columns @ solution[: columns.shape[1]]
        before = np.linalg.norm(truth, axis=1)
        after = np.linalg.norm(truth - predicted, axis=1)
        assert before.max() > 25.0
        assert after.max() < 4.0
        assert np.sqrt(np.mean(before**2)) > 10.0 * np.sqrt(np.mean(after**2))


def test_the_command_writes_whole_files(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "check.csv"
    assert main(["measure", "--seed", "1", "--kind", "check", "-o", str(target)]) == 0
    assert target.read_text(encoding="utf-8") == CHECK
    assert list(tmp_path.iterdir()) == [target]
    assert main(["measure", "-o", str(tmp_path / "no" / "where.csv")]) == 1
    assert "cannot write" in capsys.readouterr().err
