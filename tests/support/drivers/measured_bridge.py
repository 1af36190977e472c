"""The exact simulated bridge measured by a plan, and held against lines that nobody measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

import abbe.daemon.demo
from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.plan import plan_survey
from abbe.compcore.planning.targets import SurveyTask
from abbe.drivers.simulated.bridge.machine import TOOL, BridgeMachine, uniform
from abbe.drivers.simulated.bridge.placings import random_lines


@cache
def bridge() -> Machine:
    """The simulated bridge as Abbe knows it."""
    return load_model(Path(abbe.daemon.demo.__file__).parent / "bridge.toml").machine


@dataclass(frozen=True, eq=False)
class PlannedBridge:
    """A plan's rows without values, and the model that they are to be fitted by."""

    model: Model
    rows: Campaign

    def campaign(self, machine: BridgeMachine, seed: int) -> Campaign:
        """What the exact machine at 20 °C shows, through the rows' stated noise."""
        rows, rng = self.rows, np.random.default_rng([seed, 7])
        at = np.stack([rows.conditions.positions[a] for a in "XYZ"], axis=1)
        cold = np.tile(uniform(20.0), (rows.n, 1))
        tool = np.asarray(rows.conditions.tool)
        error = machine.error(at, cold, tool)
        value = np.zeros(rows.n)
        u, base = rows.conditions.u, rows.conditions.base
        for kind in np.unique(rows.kind):
            own = rows.kind == kind
            if kind == Kind.DISTANCE:
                assert base is not None
                bases = np.array([rows.bases[str(n)] for n in base[own]])
                point = at[own] + tool[own] + error[own]
                value[own] = np.linalg.norm(point - bases, axis=1)
                continue
            seen = error[own]
            if kind == Kind.ROTATION:
                state = machine.state(at[own], cold[own])
                seen = machine.exact.orientation_error(state)
            assert u is not None
            value[own] = np.einsum("ij,ij->i", seen, u[own])
        return replace(rows, value=value + rows.sd * rng.standard_normal(rows.n))


@cache
def _planned(instrument: str, hours: float) -> PlannedBridge:
    machine = replace(bridge(), signals={})
    model = start_model(machine, StartOptions(play=True))
    return measured_by(instrument, hours, model)


def measured_by(instrument: str, hours: float, model: Model | None = None) -> PlannedBridge:
    """What instruments show in a time, as `abbe plan` chooses; by the start model where none is."""
    if model is None:
        return _planned(instrument, hours)
    task = SurveyTask(model, tools={"P": TOOL})
    plan = plan_survey(task, instruments_called(instrument.split(",")), hours * 3600.0)
    return PlannedBridge(model, plan.rows())


def on_unseen_lines(machine: BridgeMachine, model: Model | None, seed: int = 5) -> float:
    """RMS of the errors along 50 lines anywhere, each less its mean, that a model leaves, µm."""
    found = []
    for line in random_lines(np.random.default_rng(seed)):
        at = line.positions
        n = len(at)
        left = machine.error(at, np.tile(uniform(20.0), (n, 1)), TOOL) @ line.u
        if model is not None:
            positions = {a: at[:, i] for i, a in enumerate("XYZ")}
            there = Conditions(positions=positions, tool=np.tile(TOOL, (n, 1)))
            left = left - model.predict(there).translation @ line.u
        found.append(left - left.mean())
    return float(np.sqrt(np.mean(np.concatenate(found) ** 2)) * 1e3)
