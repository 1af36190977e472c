"""An arm of six joints: every joint a little wrong, the shoulder giving way under the forearm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.explain import formula
from abbe.compcore.diagnosis.mistaken import mistakes
from abbe.compcore.diagnosis.pictures import IN_VOLUME, OVER_TIME
from abbe.compcore.diagnosis.stepwise.to_the_verdict import to_the_verdict
from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect

F64 = NDArray[np.float64]

JOINTS = ("C1", "B2", "B3", "C4", "B5", "C6")
PLACES = np.array(
    [[-50, 0, -1050], [0, 0, -1050], [0, 0, -550], [0, 0, -300], [0, 0, 0], [0, 0, 60]], float
)
TOOL = np.array([-30.0, -20.0, 200.0])


def turned(joint: str, angle: F64) -> Rotation:
    """A turn about Z (C) or Y (B)."""
    about = np.array([0.0, 0.0, 1.0] if joint[0] == "C" else [0.0, 1.0, 0.0])
    return Rotation.from_rotvec(angle[:, None] * about)


def tips(q: F64, errors: dict[str, F64] | None = None, sags: F64 | None = None) -> F64:
    """Where the tool's tip is, (n, 3), by plain products of rotations.

    errors: joint → shift of its line in mm, and the lean and zero of it in rad, six figures;
    sags: how much shoulder and elbow turn under the weight of the upper arm and the forearm, rad.
    """
    q = q.copy()
    if sags is not None:
        upper, fore = q[:, 1], q[:, 1] + q[:, 2]
        q[:, 1] += sags[0] * np.sin(upper) + sags[1] * np.sin(fore)
        q[:, 2] += sags[2] * np.sin(fore)
    at, turn = np.zeros((len(q), 3)), Rotation.identity(len(q))
    before = np.zeros(3)
    for k, joint in enumerate(JOINTS):
        at = at + turn.apply(PLACES[k] - before)
        before = PLACES[k]
        wrong = np.zeros(6) if errors is None else errors[joint]
        at = at + turn.apply(wrong[:3])
        turn = turn * Rotation.from_rotvec(wrong[3:]) * turned(joint, q[:, k])
    return np.asarray(at + turn.apply(TOOL - before))


def poses(rng: np.random.Generator, n: int) -> F64:
    """Poses with the arm above the ground."""
    most = np.radians([90.0, 70.0, 60.0, 150.0, 90.0, 150.0])
    q = rng.uniform(-most, most, (n, 6))
    q[:, 2] += np.radians(60.0)
    return q


def measured(
    tmp_path: Path, seed: int, drawn_wrong: dict[str, F64] | None = None
) -> tuple[Model, Path, Path]:
    """The bare arm, a campaign of 40 poses by a tracker, and another of 100.

    drawn_wrong: joint → how much further off its line is than joints are, mm and rad.
    """
    rng = np.random.default_rng(seed)
    errors = {
        joint: np.concatenate([rng.normal(0.0, 0.1, 3), rng.normal(0.0, 3e-4, 3)])
        for joint in JOINTS
    }
    for joint, more in (drawn_wrong or {}).items():
        errors[joint] = errors[joint] + more
    sags = np.array([8e-4, 3e-4, 7e-4])
    head = ['format = "abbe-model/1"', "[machine]", f'structure = "w b {" ".join(JOINTS)} t"']
    head.append('composition = "exact"')
    for joint, place in zip(JOINTS, PLACES, strict=True):
        head += [
            f"[machine.axes.{joint}]",
            "travel = [-200.0, 200.0]",
            f"location = {place.tolist()}",
        ]
    (tmp_path / "arm.toml").write_text("\n".join(head) + "\n", "utf-8")
    paths = []
    for name, n in (("fitted", 40), ("others", 100)):
        q = poses(rng, n)
        off = 1e3 * (tips(q, errors, sags) - tips(q)) + rng.normal(0.0, 10.0, (n, 3))
        rows = ['# format = "abbe-campaign/1"', "# [setups.tracker]", '# free = ["frame"]']
        rows.append(",".join(["setup,kind", *JOINTS, "tool_x,tool_y,tool_z,ux,uy,uz,value,sd"]))
        for angles, error in zip(np.degrees(q), off, strict=True):
            for u, value in zip(np.eye(3, dtype=int), error, strict=True):
                told = [*(f"{a:.7f}" for a in angles), *map(str, TOOL), *map(str, u)]
                rows.append(f"tracker,displacement,{','.join(told)},{value:.3f},10")
        paths.append(tmp_path / f"{name}.csv")
        paths[-1].write_text("\n".join(rows) + "\n", "utf-8")
    return load_model(tmp_path / "arm.toml"), paths[0], paths[1]


def left(model: Model, path: Path) -> float:
    """What a fitted model leaves of rows that it was not fitted to, µm rms."""
    return 1e3 * compare(model, read_campaign(path, model.machine)).lengths.rms


def with_all(model: Model) -> Model:
    """What who knows an arm fits: all joints' lines, the flange, what sags."""
    keys = [("rotary_location", {"axis": joint}) for joint in JOINTS]
    keys += [("gravity_flexure", {"axis": joint}) for joint in ("B2", "B3")]
    for kind, where in (*keys, ("spindle_location", {})):
        model, _ = with_effect(model, kind, where)
    return with_effect(model, "gravity_flexure", {"axis": "B2", "by": "B3"})[0]


def test_an_arm_is_found_as_well_as_by_who_knows_what_it_lacks(tmp_path: Path) -> None:
    model, fitted, others = measured(tmp_path, 1)
    campaign = read_campaign(fitted, model.machine)
    course = to_the_verdict(model, campaign)
    found = course.steps[-1].result.model
    known = fit(with_all(model), campaign).model
    assert left(found, others) <= 1.1 * left(known, others) < 0.1 * left(model, others)
    weights = [e.spec for e in found.effects if e.kind == "gravity_flexure"]
    assert "gravity_flexure axis=B2 by=B3" in weights


def test_the_picture_of_an_arm_is_where_its_tool_stood(tmp_path: Path) -> None:
    model, fitted, _ = measured(tmp_path, 1)
    found = diagnose(model, read_campaign(fitted, model.machine))
    figures = found.figures()
    assert IN_VOLUME in figures
    # no column says when
    assert OVER_TIME not in figures
    x = np.asarray(figures[IN_VOLUME]()["data"][0]["x"], dtype=float)
    assert np.nanmax(x) - np.nanmin(x) > 500.0


def test_an_arm_that_is_drawn_wrong_is_nobodys_turned_sign(tmp_path: Path) -> None:
    # a real one's lengths were typed from memory: 47 mm of forearm beside the upper arm
    wrong = {"C4": 47.0 * np.eye(6)[1], "B2": -0.06 * np.eye(6)[5]}
    model, fitted, _ = measured(tmp_path, 1, wrong)
    assert not mistakes(model, read_campaign(fitted, model.machine))


def test_what_goes_round_with_joints_has_no_formula_along_a_direction_of_the_room(
    tmp_path: Path,
) -> None:
    model, fitted, _ = measured(tmp_path, 1)
    campaign = read_campaign(fitted, model.machine)
    q = campaign.conditions.positions
    product = 0.5 * np.sin(q["B2"]) * np.sin(q["C4"]) * campaign.conditions.u[:, 2]
    placed = with_effect(model, "rotary_location", {"axis": "B2"})[0]
    found = diagnose(placed, replace(campaign, value=campaign.value + product))
    along = [s for s in found.structure if str(s.pattern.error_motion) == "dZ"]
    assert along
    assert all({"B2", "C4"} & set(s.depends_on) for s in along)
    assert not any(formula(s) for s in along)
