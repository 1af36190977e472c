"""Two hours by laser of a boring mill with a rotary table: no exact machine errs more than before.

Its true errors are only of scales, or only of squarenesses: what diagonals cannot tell apart.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.plan import plan_survey
from abbe.compcore.planning.targets import SurveyTask
from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine, State

F64 = NDArray[np.float64]

TABLE = (500.0, 0.0, -300.0)
TRAVELS = {"B": (0.0, 2 * pi), "X": (0.0, 1000.0), "Z": (-600.0, 0.0), "Y": (0.0, 800.0),
           "W": (-300.0, 0.0)}  # fmt: skip
TOOL = (0.0, 0.0, -100.0)


@cache
def planned() -> tuple[Model, Campaign]:
    """The model to begin with, and the rows of two hours."""
    axes = {a: Axis(a, t, location=TABLE if a == "B" else (0, 0, 0)) for a, t in TRAVELS.items()}
    machine = Machine("mill", Structure.parse("w B' X' Z' b Y W (C) t"), axes)
    model = start_model(machine, StartOptions(play=True, rotary_motions=True))
    task = SurveyTask(model, tools={"P": TOOL})
    plan = plan_survey(task, instruments_called(["laser", "rotary-calibrator"]), 7200.0)
    assert plan.stays is not None
    assert plan.stays < 0.65
    return model, plan.rows()


def mill(scale: float, angle: float) -> ExactMachine:
    """Scales (1) and squarenesses (rad) that are off, with a wave, and the table's angle."""
    axes = {
        "B": ExactAxis(actual=lambda s: np.asarray(s["B"]) + 40e-6 * np.sin(s["B"]), location=TABLE)
    }
    for axis in "XYZ":
        low, high = TRAVELS[axis]

        def actual(s: State, a: str = axis, at: float = low, far: float = high) -> F64:
            q = np.asarray(s[a], dtype=float)
            part = (q - at) / (far - at)
            return np.asarray(q + scale * ((far - at) * (part - 0.5) + 200.0 * np.sin(7 * part)))

        turn = {"X": (0, 0, 0), "Y": (0, 0, angle), "Z": (-angle, angle, 0)}[axis]
        axes[axis] = ExactAxis(actual=actual, mount=(0, 0, 0, *turn))
    return ExactMachine("w B' X' Z' b Y W t", axes)


def moves(nominal: F64) -> F64:
    """Where the part lies on the table, and how long the tool is: every part has a datum."""
    x, y, z = (nominal[:, :3] @ np.array([*TOOL, 1.0])).T
    none, count = np.zeros_like(x), len(x)
    turns = [[none, z, -y], [-z, none, x], [y, -x, none]]
    lies = np.broadcast_to(np.eye(3), (count, 3, 3))
    turned = np.moveaxis(np.array(turns), 2, 0)
    return np.concatenate([lies, turned, nominal[:, :3, :3]], axis=2).reshape(3 * count, 9)


@pytest.mark.parametrize(("scale", "angle"), [(30e-6, 0.0), (0.0, 40e-6)])
def test_a_correction_is_no_larger_than_what_was_learnt(scale: float, angle: float) -> None:
    model, rows = planned()
    true = mill(scale, angle)
    at = {a: rows.conditions.positions[a] for a in TRAVELS}
    u, tool = rows.conditions.u, np.asarray(rows.conditions.tool)
    assert u is not None
    lengths, turns = true.error(at, tool), true.orientation_error(at)
    value = np.einsum("ni,ni->n", np.where(rows.kind[:, None] == 0, lengths, turns), u)
    rng = np.random.default_rng(1)
    campaign = replace(rows, value=value + 0.3 * rows.sd * rng.standard_normal(rows.n))
    careful = cautiously(fit(model, campaign)).model
    where = {a: rng.uniform(*t, 300) for a, t in TRAVELS.items()}
    tools = np.tile(TOOL, (300, 1))
    found = careful.predict(Conditions(where, tool=tools)).translation
    sent = where | {a: where[a] - found[:, "XYZ".index(a)] for a in "XYZ"}
    nominal = true.nominal_pose(where)
    before, after = (
        (true.pose(s)[:, :3] - nominal[:, :3]) @ np.array([*TOOL, 1.0]) for s in (where, sent)
    )
    free = moves(nominal)
    rms = [float(np.linalg.norm(e.ravel() - free @ np.linalg.lstsq(free, e.ravel())[0]))
           for e in (before, after)]  # fmt: skip
    assert rms[1] < 0.7 * rms[0]
    # that nobody measured where the table stands does not shift the machine
    assert np.linalg.norm(found.mean(axis=0)) < 4e-3
