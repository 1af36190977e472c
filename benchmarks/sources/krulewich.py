"""Krulewich: a whole machine from distances between base points and the tool.

Structure ``w Z' b X Y (C) t``, 500 mm cube, two tools, bases, tool offsets and the spindle's lean
unknown; 500 random positions, distances of 350 to 724 mm only, noise 0.61 µm. The truth is an exact
chain of rigid bodies; what is asked is the error along face and body diagonals that were not
measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Tool
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine
from benchmarks.sources.campaigns import Rows

F64 = NDArray[np.float64]
Truth = Literal["polynomial", "wavy"]

SIDE = 500.0
NOISE = 0.61e-3
RANGE = (350.0, 724.0)
BASES = {
    "B1": (-60.0, -50.0, -250.0),
    "B2": (560.0, -60.0, -260.0),
    "B3": (240.0, 560.0, -240.0),
    "B4": (260.0, 170.0, -420.0),
}
TOOLS = {"T1": (0.012, -0.008, -60.0), "T2": (-0.015, 0.011, -240.0)}
"""Radial offsets at spindle angle 0 and lengths, mm."""
LEAN = (0.0, 60e-6, 0.0)
"""The spindle's mounting turned about x, y, z, rad."""
_DEGREES = {"roll": 3, "other": 4}


@dataclass(frozen=True)
class Experiment:
    """One simulated campaign with its truth."""

    machine: ExactMachine
    campaign: Campaign
    coverage: float
    """Share of the positions that at least one base point reaches."""


def error_motions(rng: np.random.Generator, truth: Truth) -> dict[str, ExactAxis]:
    """Smooth random error motions: Legendre series, or series of waves that no polynomial ends.

    Straightness and positioning some 10 µm, angles some 20 µrad: 30 to 60 µm at the tool.
    """
    axes = {}
    for name in "XYZ":
        size = np.array([6e-3, 6e-3, 6e-3, 14e-6, 14e-6, 14e-6])
        if truth == "polynomial":
            series = [
                np.polynomial.Legendre(
                    rng.normal(size=(_DEGREES["roll" if k == 3 + "XYZ".index(name) else "other"]))
                    * size[k]
                    / 1.6
                )
                for k in range(6)
            ]
        else:
            series = [_waves(rng, size[k]) for k in range(6)]

        def six(state, name=name, series=series):  # type: ignore[no-untyped-def]
            x = 2.0 * np.asarray(state[name]) / SIDE - 1.0
            return np.stack([s(x) for s in series], axis=-1)

        axes[name] = ExactAxis(error=six)
    axes["(C)"] = ExactAxis(mount=(0.0, 0.0, 0.0, *LEAN))
    return axes


def _waves(rng: np.random.Generator, size: float):  # type: ignore[no-untyped-def]
    amplitude = rng.normal(size=4) * size / np.array([0.7, 1.5, 4.0, 10.0])
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    rate = np.pi * np.array([0.4, 0.8, 1.2, 1.6])
    return lambda x: (amplitude * np.sin(np.multiply.outer(x, rate) + phase)).sum(axis=-1)


def simulate(
    seed: int, *, truth: Truth = "polynomial", bases: int = 3, bias: float = 0.0
) -> Experiment:
    """One campaign: positions in random order, a turning spindle, distances between bases."""
    rng = np.random.default_rng(seed)
    machine = ExactMachine("w Z' b X Y (C) t", error_motions(rng, truth))
    names = list(BASES)[:bases]
    rows = Rows(("X", "Y", "Z"))
    positions = {a: rng.uniform(0.0, SIDE, 500) for a in "XYZ"}
    reached = np.zeros(500, dtype=bool)
    for base, tool in product(names, TOOLS):
        chosen = _distances(machine, positions, 0.0, base, tool)
        within = (chosen > RANGE[0]) & (chosen < RANGE[1])
        # not every point from every base: what is out of reach is replaced
        pool = {a: rng.uniform(0.0, SIDE, 4000) for a in "XYZ"}
        lengths = _distances(machine, pool, 0.0, base, tool)
        spare = np.flatnonzero((lengths > RANGE[0]) & (lengths < RANGE[1]))[: (~within).sum()]
        used = {a: np.concatenate([positions[a][within], pool[a][spare]]) for a in "XYZ"}
        reached |= within
        _add(rows, machine, rng, used, 0.0, base, tool, bias)
        turn = np.deg2rad(np.arange(0.0, 360.0, 10.0))
        centre = {a: np.full(len(turn), 0.5 * SIDE) for a in "XYZ"}
        _add(rows, machine, rng, centre, turn, base, tool, bias)
    for i, one in enumerate(names):
        for two in names[i + 1 :]:
            apart = float(np.linalg.norm(np.subtract(BASES[one], BASES[two])))
            values = np.full(4, apart) + rng.normal(0.0, NOISE, 4) + bias
            rows.add("bases", Kind.BASE_DISTANCE, {}, values, NOISE, free=(), base=one, base2=two)
    count = sum(len(b["value"]) for b in rows.blocks)
    nominal = {
        name: tuple(np.round(np.add(BASES[name], rng.uniform(-2.0, 2.0, 3)), 1)) for name in names
    }
    tools = {
        name: Tool(
            name,
            (0.0, 0.0, float(np.round(offset[2] + rng.uniform(-0.5, 0.5), 1))),
            ("x", "y", "z"),
        )
        for name, offset in TOOLS.items()
    }
    campaign = rows.campaign("distances", bases=nominal, tools=tools, order=rng.permutation(count))
    return Experiment(machine, campaign, float(reached.mean()))


def _distances(
    machine: ExactMachine, positions: dict[str, F64], turn: F64 | float, base: str, tool: str
) -> F64:
    point = machine.point({**positions, "(C)": turn}, TOOLS[tool])
    return np.linalg.norm(point - np.asarray(BASES[base]), axis=-1)


def _add(
    rows: Rows,
    machine: ExactMachine,
    rng: np.random.Generator,
    positions: dict[str, F64],
    turn: F64 | float,
    base: str,
    tool: str,
    bias: float,
) -> None:
    lengths = _distances(machine, positions, turn, base, tool)
    rows.add(
        f"{base} {tool}",
        Kind.DISTANCE,
        positions,
        lengths + rng.normal(0.0, NOISE, len(lengths)) + bias,
        NOISE,
        free=(),
        tool_name=tool,
        base=base,
        spindle=turn,
    )


def model(shape: str = "polynomial", *, bias: bool = False) -> Model:
    """The machine with 18 error motions and the spindle's lean; squareness is in the slopes.

    `shape`: ``polynomial`` (degree 3 for rolls, 4 for the others) or ``spline:N``.
    """
    axes = {a: Axis(a, (0.0, SIDE)) for a in "XYZ"}
    machine = Machine("horizontal mill", Structure.parse("w Z' b X Y (C) t"), axes)
    effects: list[Effect] = []
    for a in "XYZ":
        effects.append(make_effect("positioning", {"axis": a, "shape": _shape(shape, False)}))
        for k in "XYZ":
            roll = k == a
            keys = {"axis": a, "about": k, "shape": _shape(shape, roll)}
            effects.append(make_effect("angular", keys))
            if k != a:
                keys = {"axis": a, "direction": k, "shape": _shape(shape, False)}
                effects.append(make_effect("straightness", keys))
    effects += [make_effect("spindle_squareness", {"direction": d}) for d in "XY"]
    if bias:
        effects.append(make_effect("length_bias", {}))
    return Model(machine).with_effects(*effects)


def _shape(shape: str, roll: bool) -> str:
    if shape != "polynomial":
        return shape
    return f"polynomial:{_DEGREES['roll' if roll else 'other']}"


@dataclass(frozen=True)
class Diagonals:
    """How well diagonals are predicted that were not measured.

    Attributes
    ----------
    before, after
        Peak to valley of each diagonal's error, and of what the model leaves of it, mm.
    inside
        Share of points whose true error lies within the stated 95 % interval.
    """

    before: F64
    after: F64
    inside: float

    @property
    def explained(self) -> float:
        """Share of the error that is predicted: 1 − (worst left) / (worst before)."""
        return 1.0 - float(self.after.max() / self.before.max())


def diagonals(machine: ExactMachine, fitted: Model) -> Diagonals:
    """Body and face diagonals as a laser sees them: along the line, from its first point."""
    corners = [np.array(c) for c in product((0.0, SIDE), repeat=3)]
    ends = [(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :] if (a != b).sum() >= 2]
    before, after, inside, count = [], [], 0, 0
    tool = TOOLS["T1"]
    for a, b in ends:
        part = np.linspace(0.0, 1.0, 26)[:, None]
        line = a + part * (b - a)
        u = (b - a) / np.linalg.norm(b - a)
        state = {k: line[:, i] for i, k in enumerate("XYZ")} | {"(C)": 0.0}
        true = machine.error(state, tool) @ u
        conditions = Conditions(
            {k: line[:, i] for i, k in enumerate("XYZ")}, tool=np.tile(tool, (26, 1))
        )
        predicted = fitted.predict(conditions).translation @ u
        before.append(np.ptp(true - true[0]))
        left = (true - predicted) - (true - predicted)[0]
        after.append(np.ptp(left))
        sd = _difference_sd(fitted, conditions, u)
        inside += int((np.abs(left[1:]) <= 1.96 * sd[1:]).sum())
        count += len(left) - 1
    return Diagonals(np.array(before), np.array(after), inside / count)


def _difference_sd(fitted: Model, conditions: Conditions, u: F64) -> F64:
    """Standard uncertainty of what is predicted along a line, from its first point."""
    from abbe.compcore.model.sensitivity import sensitivities

    moved, _ = sensitivities(fitted, conditions)
    along = np.einsum("nip,i->np", moved, u)
    along = along - along[0]
    assert fitted.covariance is not None
    return np.sqrt(np.einsum("np,pq,nq->n", along, fitted.covariance, along))


def run(
    seed: int, shape: str, *, truth: Truth = "polynomial", bases: int = 3, bias: float = 0.0
) -> tuple[Experiment, FitResult, Diagonals]:
    """Simulate, fit, predict."""
    experiment = simulate(seed, truth=truth, bases=bases, bias=bias)
    result = fit(model(shape, bias=bias != 0.0), experiment.campaign)
    return experiment, result, diagonals(experiment.machine, result.model)
