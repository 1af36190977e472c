"""The design matrix and the fit on machines of other structures, with rotary axes and spindles."""

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind, Tool
from abbe.compcore.effects import effect_kinds, make_effect
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.compcore.model.model import Model
from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine, rigid
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import random_theta, with_truth

STRUCTURES = (
    "w b Y X Z t",
    "w X' b Y Z t",
    "w Z' b X Y (C) t",
    "w C' A' Y' b X Z t",
    "w X' b Y Z C B t",
    "w C' X' b Z Y t",
)
BASES = {"B1": (-300.0, 50.0, -40.0), "B2": (420.0, -380.0, 30.0)}
TOOLS = {
    "T1": Tool("T1", (1.0, 2.0, -90.0), ("x", "z")),
    "T2": Tool("T2", (5.0, -8.0, -150.0), ("x", "y", "z")),
}


def described(code: str) -> Machine:
    structure = Structure.parse(code)
    axes = {}
    for name in structure.axes:
        if is_rotary(name):
            axes[name] = Axis(name, (-1.5, 1.5), location=(20.0, -30.0, 40.0))
        else:
            axes[name] = Axis(name, (-200.0, 250.0))
    signals = {"T_a": Signal("T_a", "degC", "scale", structure.linear[0])}
    return Machine(code, structure, axes, signals)


def measured(machine: Machine, rng: np.random.Generator, n: int = 25):
    rows = Rows(machine.structure.axes)

    def place() -> dict[str, np.ndarray]:
        return {a: rng.uniform(*machine.axes[a].travel, n) for a in machine.structure.axes}

    def around() -> dict[str, object]:
        return {
            "signals": {"T_a": 20.0 + rng.normal(size=n)},
            "time": np.sort(rng.uniform(0.0, 5000.0, n)),
            "directions": {a: rng.choice([-1.0, 1.0], n) for a in machine.structure.axes},
            "spindle": rng.uniform(0.0, 6.0, n) if machine.structure.spindle else 0.0,
        }

    for k in range(6):
        u = rng.normal(size=(n, 3))
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        kind = Kind.ROTATION if k % 3 == 2 else Kind.DISPLACEMENT
        sd = 1e-6 if kind == Kind.ROTATION else 1e-3
        free = (("zero",), ("frame",), ())[k // 2]
        tool = tuple(rng.uniform(-60.0, 60.0, 3))
        rows.add(f"s{k}", kind, place(), np.zeros(n), sd, u=u, free=free, tool=tool, **around())
    for base in BASES:
        for tool_name in TOOLS:
            keys = {"free": (), "base": base, "tool_name": tool_name, **around()}
            rows.add("d", Kind.DISTANCE, place(), np.zeros(n), 1e-3, **keys)
    keys = {"signals": {"T_a": 20.0}, "base": "B1", "base2": "B2"}
    rows.add("b", Kind.BASE_DISTANCE, {}, np.zeros(2), 1e-3, free=(), **keys)
    return rows.campaign("everything", bases=BASES, tools=TOOLS)


def everything(machine: Machine, campaign) -> Model:
    """One instance of every kind of effect that proposes itself."""
    coverage = campaign.coverage()
    effects = []
    for cls in effect_kinds().values():
        found = list(cls.candidates(machine, coverage))
        # moments and places of steps are searched, not sloped
        stepped = cls.kind in ("event", "joint", "dead_path")
        if found and not cls.kind.startswith("setup_") and not stepped:
            effects.append(found[len(found) // 2])
    return Model(machine).with_effects(*effects)


@pytest.mark.parametrize("code", STRUCTURES)
def test_columns_are_slopes_of_the_prediction_for_every_kind_of_effect(code: str) -> None:
    rng = np.random.default_rng(len(code))
    machine = described(code)
    campaign = measured(machine, rng)
    model = everything(machine, campaign)
    assert len(model.effects) > 12
    problem = Problem(model, campaign)
    theta = random_theta(model, campaign, rng, part=0.02)
    found = problem.columns(theta)
    for k, unknown in enumerate(problem.layout.unknowns):
        step = 1e-3 * unknown.scale if not unknown.nonlinear else 1e-4 * max(abs(theta[k]), 1.0)
        ends = []
        for sign in (1.0, -1.0):
            moved = theta.copy()
            moved[k] += sign * step
            ends.append(problem.predicted(moved) * problem.weight)
        slope = (ends[0] - ends[1]) / (2.0 * step)
        # to first order: the errors' own size, some 1e-3 of the arms, is left; of a thermometer's
        # offset beside its gain the gain, here up to some per cent
        amends = unknown.owner >= 0 and model.effects[unknown.owner].reads_model
        left = 2e-2 if amends else 4e-3
        assert found[:, k] == pytest.approx(slope, abs=left * np.abs(slope).max() + 1e-9), unknown


@pytest.mark.parametrize("code", ["w b Y X Z t", "w C' X' b Z Y t", "w X' b Y Z C B t"])
def test_a_fit_recovers_all_that_it_says_it_knows(code: str) -> None:
    rng = np.random.default_rng(1)
    machine = described(code)
    campaign = measured(machine, rng, 60)
    linear = [
        e
        for e in everything(machine, campaign).effects
        if not e.nonlinear(machine) and not e.reads_model and e.scope == "machine"
    ]
    model = Model(machine).with_effects(*linear)
    theta = random_theta(model, campaign, rng, part=0.02)
    noisy = with_truth(model, campaign, theta, rng)
    result = fit(model, noisy)
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.3)
    # what is determined is found within its uncertainty, whatever frame was chosen
    known = result.decomposition.determined
    apart = known.T @ ((result.theta - theta) / result.problem.layout.scale)
    sd = 1.0 / result.decomposition.singular[: known.shape[1]]
    assert np.sqrt(np.mean((apart / sd) ** 2)) < 1.5


@pytest.mark.parametrize("code", ["w C' A' Y' b X Z t", "w C' X' b Z Y t"])
def test_an_artefact_on_a_rotary_table_turns_with_it(code: str) -> None:
    """Balls that lie elsewhere on the table than was thought: nothing but the set-up's frame."""
    rng = np.random.default_rng(5)
    machine = described(code)
    rotary = {a: ExactAxis(location=(20.0, -30.0, 40.0)) for a in machine.structure.rotary}
    exact = ExactMachine(code, rotary)
    place = {a: rng.uniform(*machine.axes[a].travel, 60) for a in machine.structure.axes}
    pose = exact.nominal_pose(place)
    at = exact.point(place, (0.0, 0.0, -80.0))
    # where the tool meets a displaced ball, it errs by the same in the table's frame
    displaced = rigid([0.03, -0.02, 0.05, 40e-6, -70e-6, 30e-6])
    error = at @ displaced[:3, :3].T + displaced[:3, 3] - at
    u = rng.normal(size=(60, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    value = (np.einsum("nji,nj->ni", pose[:, :3, :3], error) * u).sum(axis=1)
    rows = Rows(machine.structure.axes)
    keys = {"u": u, "free": ("frame",), "tool": (0.0, 0.0, -80.0), "signals": {"T_a": 20.0}}
    rows.add("plate", Kind.DISPLACEMENT, place, value, 1e-6, **keys)
    axial = make_effect("rotary_axial", {"axis": "C"})
    result = fit(Model(machine).with_effects(axial), rows.campaign("plate"))
    assert np.abs(value).max() > 0.02
    assert np.abs(result.residual).max() < 1e-5
