"""A plan carried out on an exact machine: what an instrument reads, as a campaign file holds it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import ExactMachine
from benchmarks.hidden.campaigns import shop
from benchmarks.hidden.campaigns.plan import Planner
from benchmarks.hidden.causes.cause import POINT, READING, SENSOR, Cause

F64 = NDArray[np.float64]

NOISE = 0.5e-3
"""Standard deviation of a displacement, mm, plus `NOISE_LENGTH` of the length."""
NOISE_LENGTH = 0.3e-6
ANGLE_NOISE = 0.6e-6

Hidden: TypeAlias = Sequence[tuple[Cause, float]]
"""Causes with their amplitudes."""


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


def measure(
    exact: Callable[[Hidden], ExactMachine],
    linear: tuple[str, ...],
    planner: Planner,
    rng: np.random.Generator,
    causes: Hidden,
    *,
    weather: bool = False,
) -> Simulated:
    """Carry out a plan through a day.

    Parameters
    ----------
    exact
        The machine with causes hidden in it.
    linear
        Its linear axes, workpiece to tool.
    planner
        What is measured, where and when.
    rng
        Of the day: temperatures, noise.
    causes
        What is hidden.
    weather
        Whether a barometer is recorded.
    """
    state, signals = conditions(planner, linear, rng, weather=weather)
    u, tool = np.array(planner.rows.u), np.array(planner.rows.tool)
    rotation = state["rotation"]

    bed = _bed(exact(()).structure, state)

    def seen(hidden: Hidden) -> F64:
        return _seen(exact(hidden), hidden, state, tool, bed)

    value = seen(causes)
    hidden = value - seen(())
    for cause, size in causes:
        if cause.place == SENSOR:
            # what its user's correction gets wrong is as large as the error it corrects
            (name,) = cause.depends
            wrong = size * cause.motion(state)
            signals[name] = signals[name] + wrong
            corrected = state | {name: state[name] + wrong}
            hidden += seen(()) - _seen(exact(()), (), corrected, tool, bed)
    sd = np.where(rotation, ANGLE_NOISE, NOISE + NOISE_LENGTH * _lengths(planner, rotation))
    # where the instrument was placed is unknown: each set-up has its own zero, some their slope
    setups = np.array(planner.rows.setup)
    offsets = np.zeros(len(value))
    for name in dict.fromkeys(planner.rows.setup):
        rows = setups == name
        if "frame" in planner.free[name]:
            # a ball that lies a little elsewhere on the workpiece
            place = _into(bed, u)[rows]
            offsets[rows] = place @ rng.normal(0.0, 0.02, 3)
            hidden[rows] -= place @ np.linalg.lstsq(place, hidden[rows])[0]
            continue
        if "zero" not in planner.free[name]:
            continue
        offsets[rows] = rng.normal(0.0, 0.02 if not rotation[rows][0] else 30e-6)
        hidden[rows] -= hidden[rows].mean()
    measured = value + offsets + sd * rng.standard_normal(len(value))
    return Simulated(_text(planner, state, signals, measured, sd, rotation), hidden)


def conditions(
    planner: Planner, linear: tuple[str, ...], rng: np.random.Generator, *, weather: bool = False
) -> tuple[dict[str, Any], dict[str, F64]]:
    """The state at each row of a plan, and what is recorded of its signals."""
    rows = planner.rows
    time = np.array(rows.time)
    clock, true, recorded = shop.record(rng, linear, float(time[-1]) + 60.0)
    if weather:
        true["P_air"], recorded["P_air"] = shop.weather(rng, clock)
    q, s = np.array(rows.position), np.array(rows.direction)
    state: dict[str, Any] = {a: q[:, k] for k, a in enumerate(planner.axes)}
    state |= {f"{a}_dir": s[:, k] for k, a in enumerate(planner.axes)}
    state |= {name: np.interp(time, clock, course) for name, course in true.items()}
    state |= {"u": np.array(rows.u), "rotation": np.array(rows.kind) == "rotation"}
    state |= {"t": time, "clock": clock, "courses": true, "setup": np.array(rows.setup)}
    return state, {name: np.interp(time, clock, c) for name, c in recorded.items()}


def _bed(structure: str, state: dict[str, Any]) -> F64 | None:
    """Turn of machine axes as seen from the workpiece, (n, 3, 3); None where nothing turns it."""
    table = structure.split(" b ")[0].split()[1:]
    if not any(word[0] in "ABC" for word in table):
        return None
    pose = ExactMachine(" ".join(["w", *table, "b", "t"])).nominal_pose(state)
    return np.asarray(pose[:, :3, :3])


def _into(bed: F64 | None, vector: F64) -> F64:
    """Vectors (n, 3) in machine axes as seen from the workpiece."""
    return vector if bed is None else np.asarray(np.einsum("nij,nj->ni", bed, vector))


def _seen(
    exact: ExactMachine, causes: Hidden, state: dict[str, Any], tool: F64, bed: F64 | None
) -> F64:
    """What an instrument without noise reads, (n,), mm or rad."""
    u = _into(bed, state["u"])
    error = exact.error(state, tool)
    for cause, size in causes:
        if cause.place == POINT:
            error = error + size * _into(bed, cause.motion(state)[:, :3])
    turn = exact.orientation_error(state)
    value = np.where(state["rotation"], (turn * u).sum(axis=1), (error * u).sum(axis=1))
    for cause, size in causes:
        if cause.place == READING:
            value = value + size * cause.motion(state)
    return np.asarray(value)


def _lengths(planner: Planner, rotation: NDArray[np.bool_]) -> F64:
    q = np.array(planner.rows.position)[:, :3]
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
        *planner.axes,
        *(f"{a}_dir" for a in planner.axes),
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
    position = {a: np.rad2deg(state[a]) if a in "ABC" else state[a] for a in planner.axes}
    for i in range(len(measured)):
        fields = [f"{rows.time[i]:.1f}", rows.setup[i], rows.kind[i]]
        fields += [f"{position[a][i]:.4f}" for a in planner.axes]
        fields += [f"{state[a + '_dir'][i]:.0f}" for a in planner.axes]
        fields += [f"{v:g}" for v in rows.tool[i]]
        fields += [f"{v:.12f}" for v in rows.u[i]]
        fields += [f"{measured[i] * factor[i]:.4f}", f"{sd[i] * factor[i]:.4f}"]
        fields += [f"{signals[name][i]:.3f}" for name in names]
        lines.append(",".join(fields))
    return "\n".join(lines) + "\n"
