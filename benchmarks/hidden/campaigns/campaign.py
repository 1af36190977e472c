"""A simulated machine measured: campaign text and model text, as files would hold them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine
from benchmarks.hidden.campaigns import shop
from benchmarks.hidden.campaigns.measuring import Hidden, Simulated, measure
from benchmarks.hidden.campaigns.plan import calibration, check

F64 = NDArray[np.float64]

STRUCTURES: dict[str, tuple[str, dict[str, tuple[float, float]]]] = {
    "bridge": ("w b Y X Z t", {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}),
    "mill": ("w X' b Y Z t", {"X": (0.0, 800.0), "Y": (0.0, 500.0), "Z": (-450.0, 0.0)}),
    "column": ("w Z' b X Y t", {"X": (0.0, 500.0), "Y": (0.0, 500.0), "Z": (-500.0, 0.0)}),
    "table": ("w Y' X' b Z t", {"X": (0.0, 600.0), "Y": (0.0, 400.0), "Z": (-400.0, 0.0)}),
    "gantry": ("w b X Y Z t", {"X": (0.0, 1500.0), "Y": (0.0, 1000.0), "Z": (-600.0, 0.0)}),
}


@dataclass(frozen=True)
class Machine:
    """One simulated machine: geometry drawn once, causes hidden in it."""

    structure: str
    travels: dict[str, tuple[float, float]]
    waves: dict[str, F64]
    mounts: dict[str, tuple[float, ...]]
    expansion: dict[str, float]

    @property
    def axes(self) -> tuple[str, ...]:
        """Axis names, workpiece to tool."""
        return tuple(w.rstrip("'") for w in self.structure.split() if w[0] in "XYZ")


def draw(seed: int, kind: str) -> Machine:
    """A machine of a kind with smooth random error motions."""
    rng = np.random.default_rng(seed)
    structure, travels = STRUCTURES[kind]
    axes = [w.rstrip("'") for w in structure.split() if w[0] in "XYZ"]
    waves, mounts = {}, {}
    for axis in axes:
        # for each of six motions three waves: amplitude, cycles over the travel, phase
        amplitude = rng.normal(0.0, 1.0, (6, 3)) * np.array([1.0, 0.5, 0.25])
        amplitude *= np.array([[3e-3]] * 3 + [[8e-6]] * 3)
        cycles = np.stack([rng.uniform(*r, 6) for r in ((0.3, 0.6), (0.7, 1.1), (1.2, 1.6))], 1)
        waves[axis] = np.stack([amplitude, cycles, rng.uniform(0, 2 * np.pi, (6, 3))])
        mounts[axis] = (0.0, 0.0, 0.0, *rng.normal(0.0, 15e-6, 3))
    expansion = {a: float(rng.uniform(7e-6, 16e-6)) for a in axes}
    return Machine(structure, dict(travels), waves, mounts, expansion)


def _motions(axis: str, machine: Machine, causes: Hidden, state: dict[str, Any]) -> F64:
    amplitude, cycles, phase = machine.waves[axis]
    low, high = machine.travels[axis]
    x = ((state[axis] - low) / (high - low))[:, None, None]
    total = np.asarray((amplitude * np.sin(2.0 * np.pi * cycles * x + phase)).sum(axis=2))
    own = "XYZ".index(axis)
    warmth = state[f"T_{axis.lower()}"] - 20.0
    total[:, own] += machine.expansion[axis] * state[axis] * warmth
    for cause, size in causes:
        if cause.place == axis:
            total = total + size * cause.motion(state)
    return total


def simulate(
    machine: Machine, seed: int, causes: Hidden, *, held_out: bool = False, dense: int = 1
) -> Simulated:
    """Measure a machine through a day.

    Parameters
    ----------
    machine, seed
        The machine; the seed of the day (temperatures, noise).
    causes
        Hidden causes with their amplitudes.
    held_out
        Other lines than the calibration's.
    dense
        So many times the points on each line of the calibration.
    """
    rng = np.random.default_rng((seed, int(held_out)))
    axes = ("X", "Y", "Z")
    if held_out:
        planner = check(rng, axes, machine.travels)
    else:
        planner = calibration(axes, machine.travels, dense=dense)
    return measure(partial(exact, machine), machine.axes, planner, rng, causes)


def exact(machine: Machine, causes: Hidden) -> ExactMachine:
    """The exact chain of a machine with causes hidden in it."""
    return ExactMachine(
        machine.structure,
        {
            a: ExactAxis(error=partial(_motions, a, machine, causes), mount=machine.mounts[a])
            for a in machine.axes
        },
    )


def model_text(machine: Machine, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
    """The model that a user would bring: geometry and expansion, nothing fitted.

    `omits`: effects that it lacks, by kind and where-keys.
    """
    return "\n".join([*_head(machine), *_effects(machine, omits)]) + "\n"


def _effects(machine: Machine, omits: Sequence[tuple[str, Mapping[str, Any]]]) -> Iterator[str]:
    for kind, where in _geometry(machine.axes):
        if any(k == kind and where.items() >= w.items() for k, w in omits):
            continue
        yield from effect_text(kind, where)


def _geometry(axes: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Kind and where-keys of the 21 geometric errors and of the scales' expansion."""
    for axis in axes:
        yield "positioning", {"axis": axis, "shape": "spline:8"}
        for other in "XYZ":
            if other != axis:
                yield "straightness", {"axis": axis, "direction": other, "shape": "spline:8"}
            yield "angular", {"axis": axis, "about": other, "shape": "spline:8"}
        yield "scale_expansion", {"axis": axis, "signals": [f"T_{axis.lower()}"]}
    for i, one in enumerate(axes):
        for two in axes[i + 1 :]:
            yield "squareness", {"axes": [one, two]}


def effect_text(kind: str, where: Mapping[str, Any]) -> Iterator[str]:
    """The lines of a model file for one effect, not fitted."""
    yield "[[effects]]"
    yield f'kind = "{kind}"'
    yield from (f"{key} = {json.dumps(value)}" for key, value in where.items())


def _head(machine: Machine) -> list[str]:
    return [
        *machine_text(machine.structure, machine.travels),
        *signals_text(machine.axes),
    ]


def machine_text(structure: str, travels: Mapping[str, tuple[float, float]]) -> list[str]:
    """The head of a model file: the machine and its linear axes."""
    lines = [
        'format = "abbe-model/1"',
        "",
        "[machine]",
        'name = "hidden"',
        f'structure = "{structure}"',
        "reference_temperature = 20.0",
    ]
    for axis, (low, high) in travels.items():
        lines += [f"[machine.axes.{axis}]", f"travel = [{low}, {high}]"]
    return lines


def signals_text(axes: tuple[str, ...]) -> list[str]:
    """The signals that a machine with these linear axes records."""
    lines = []
    for sensor in shop.sensors(axes):
        lines += [
            f"[machine.signals.{sensor.name}]",
            f'unit = "{sensor.unit}"',
            f'role = "{sensor.role}"',
        ]
        lines += [f'axis = "{sensor.axis}"'] if sensor.axis else []
    lines += ["[machine.signals.feed]", 'unit = "mm/min"', 'role = "speed"']
    lines += ["[machine.signals.load]", 'unit = "kg"', 'role = "load"']
    return lines
