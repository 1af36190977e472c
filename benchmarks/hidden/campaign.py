"""A simulated machine measured: campaign text and model text, as files would hold them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden import shop
from benchmarks.hidden.causes import POINT, READING, Cause
from benchmarks.hidden.plan import Planner, calibration, check
from drivers.simulated.truth import ExactAxis, ExactMachine

F64 = NDArray[np.float64]

STRUCTURES: dict[str, tuple[str, dict[str, tuple[float, float]]]] = {
    "bridge": ("w b Y X Z t", {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}),
    "mill": ("w X' b Y Z t", {"X": (0.0, 800.0), "Y": (0.0, 500.0), "Z": (-450.0, 0.0)}),
    "column": ("w Z' b X Y t", {"X": (0.0, 500.0), "Y": (0.0, 500.0), "Z": (-500.0, 0.0)}),
    "table": ("w Y' X' b Z t", {"X": (0.0, 600.0), "Y": (0.0, 400.0), "Z": (-400.0, 0.0)}),
    "gantry": ("w b X Y Z t", {"X": (0.0, 1500.0), "Y": (0.0, 1000.0), "Z": (-600.0, 0.0)}),
}

NOISE = 0.5e-3
"""Standard deviation of a displacement, mm, plus `NOISE_LENGTH` of the length."""
NOISE_LENGTH = 0.3e-6
ANGLE_NOISE = 0.6e-6


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


def _motions(
    axis: str, machine: Machine, causes: Sequence[tuple[Cause, float]], state: dict[str, Any]
) -> F64:
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


@dataclass(frozen=True)
class Simulated:
    """What came out: the campaign's text and, for judging, what was hidden in every row.

    Attributes
    ----------
    text
        The campaign file.
    hidden
        What the causes add to each row, mm or rad, less its mean in the set-up: a set-up's zero is
        unknown, so that no one could see more.
    """

    text: str
    hidden: F64


def simulate(
    machine: Machine, seed: int, causes: Sequence[tuple[Cause, float]], *, held_out: bool = False
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
    """
    rng = np.random.default_rng((seed, int(held_out)))
    axes = ("X", "Y", "Z")
    planner = check(rng, axes, machine.travels) if held_out else calibration(axes, machine.travels)
    state, signals = _conditions(planner, machine, rng)
    u, tool = np.array(planner.rows.u), np.array(planner.rows.tool)
    rotation = np.array(planner.rows.kind) == "rotation"
    seen = partial(_seen, machine, state, tool, u, rotation)
    value = seen(causes)
    hidden = value - seen(())
    sd = np.where(rotation, ANGLE_NOISE, NOISE + NOISE_LENGTH * _lengths(planner, rotation))
    # where the instrument was placed is unknown: each set-up has its own zero, some their slope
    setups = np.array(planner.rows.setup)
    offsets = np.zeros(len(value))
    for name in dict.fromkeys(planner.rows.setup):
        rows = setups == name
        offsets[rows] = rng.normal(0.0, 0.02 if not rotation[rows][0] else 30e-6)
        hidden[rows] -= hidden[rows].mean()
    measured = value + offsets + sd * rng.standard_normal(len(value))
    return Simulated(_text(planner, state, signals, measured, sd, rotation), hidden)


def _conditions(
    planner: Planner, machine: Machine, rng: np.random.Generator
) -> tuple[dict[str, Any], dict[str, F64]]:
    rows = planner.rows
    time = np.array(rows.time)
    clock, true, recorded = shop.record(rng, machine.axes, float(time[-1]) + 60.0)
    q, s = np.array(rows.position), np.array(rows.direction)
    state: dict[str, Any] = {a: q[:, k] for k, a in enumerate(planner.axes)}
    state |= {f"{a}_dir": s[:, k] for k, a in enumerate(planner.axes)}
    state |= {name: np.interp(time, clock, course) for name, course in true.items()}
    state |= {"u": np.array(rows.u), "rotation": np.array(rows.kind) == "rotation"}
    state |= {"t": time, "clock": clock, "courses": true, "setup": np.array(rows.setup)}
    return state, {name: np.interp(time, clock, c) for name, c in recorded.items()}


def _seen(
    machine: Machine,
    state: dict[str, Any],
    tool: F64,
    u: F64,
    rotation: NDArray[np.bool_],
    causes: Sequence[tuple[Cause, float]],
) -> F64:
    """What an instrument without noise reads, (n,), mm or rad."""
    exact = ExactMachine(
        machine.structure,
        {
            a: ExactAxis(error=partial(_motions, a, machine, causes), mount=machine.mounts[a])
            for a in machine.axes
        },
    )
    error = exact.error(state, tool)
    for cause, size in causes:
        if cause.place == POINT:
            error = error + size * cause.motion(state)[:, :3]
    turn = exact.orientation_error(state)
    value = np.where(rotation, (turn * u).sum(axis=1), (error * u).sum(axis=1))
    for cause, size in causes:
        if cause.place == READING:
            value = value + size * cause.motion(state)
    return np.asarray(value)


def _lengths(planner: Planner, rotation: NDArray[np.bool_]) -> F64:
    q = np.array(planner.rows.position)
    setups = np.array(planner.rows.setup)
    out = np.zeros(len(q))
    for name in np.unique(setups):
        rows = setups == name
        out[rows] = np.linalg.norm(q[rows] - q[rows][0], axis=1)
    return np.where(rotation, 0.0, out)


def _text(
    planner: Planner,
    state: dict[str, Any],
    signals: dict[str, F64],
    measured: F64,
    sd: F64,
    rotation: NDArray[np.bool_],
) -> str:
    lines = [
        '# format = "abbe-campaign/1"',
        '# machine = "hidden"',
        '# instrument = "laser, levels"',
    ]
    for name, free in planner.free.items():
        words = ", ".join(f'"{w}"' for w in free)
        lines += [f"# [setups.{name}]", f"# free = [{words}]"]
    names = list(signals)
    header = [
        "time",
        "setup",
        "kind",
        "X",
        "Y",
        "Z",
        "X_dir",
        "Y_dir",
        "Z_dir",
        "tool_x",
        "tool_y",
        "tool_z",
        "ux",
        "uy",
        "uz",
        "value",
        "sd",
        *names,
    ]
    lines.append(",".join(header))
    rows = planner.rows
    factor = np.where(rotation, 1e6, 1e3)
    for i in range(len(measured)):
        fields = [f"{rows.time[i]:.1f}", rows.setup[i], rows.kind[i]]
        fields += [f"{state[a][i]:.4f}" for a in "XYZ"]
        fields += [f"{state[a + '_dir'][i]:.0f}" for a in "XYZ"]
        fields += [f"{v:g}" for v in rows.tool[i]]
        fields += [f"{v:.12f}" for v in rows.u[i]]
        fields += [f"{measured[i] * factor[i]:.4f}", f"{sd[i] * factor[i]:.4f}"]
        fields += [f"{signals[name][i]:.3f}" for name in names]
        lines.append(",".join(fields))
    return "\n".join(lines) + "\n"


def model_text(machine: Machine, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
    """The model that a user would bring: geometry and expansion, nothing fitted.

    `omits`: effects that it lacks, by kind and where-keys.
    """
    return "\n".join([*_head(machine), *_effects(machine, omits)]) + "\n"


def _effects(machine: Machine, omits: Sequence[tuple[str, Mapping[str, Any]]]) -> Iterator[str]:
    for kind, where in _geometry(machine.axes):
        if any(k == kind and where.items() >= w.items() for k, w in omits):
            continue
        yield "[[effects]]"
        yield f'kind = "{kind}"'
        yield from (f"{key} = {json.dumps(value)}" for key, value in where.items())


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


def _head(machine: Machine) -> list[str]:
    lines = [
        'format = "abbe-model/1"',
        "",
        "[machine]",
        'name = "hidden"',
        f'structure = "{machine.structure}"',
        "reference_temperature = 20.0",
    ]
    for axis, (low, high) in machine.travels.items():
        lines += [f"[machine.axes.{axis}]", f"travel = [{low}, {high}]"]
    for sensor in shop.sensors(machine.axes):
        lines += [
            f"[machine.signals.{sensor.name}]",
            f'unit = "{sensor.unit}"',
            f'role = "{sensor.role}"',
        ]
        lines += [f'axis = "{sensor.axis}"'] if sensor.axis else []
    lines += ["[machine.signals.feed]", 'unit = "mm/min"', 'role = "speed"']
    lines += ["[machine.signals.load]", 'unit = "kg"', 'role = "load"']
    return lines
