"""Scenes of a telescopic laser bar or a tracer: distances from base points all over the volume."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden.campaigns.campaign import (
    STRUCTURES,
    Machine,
    draw,
    exact,
    model_text,
    simulate,
)
from benchmarks.hidden.campaigns.measuring import NOISE, NOISE_LENGTH, Hidden, Simulated, conditions
from benchmarks.hidden.campaigns.plan import TOOLS, Planner
from benchmarks.hidden.causes.cause import READING, Cause, State

F64 = NDArray[np.float64]

HIDDEN = ("length_bias", "length_bias of one base")
BASES = 4
PLACES = 150
"""Random positions for each base point and tool."""
APPROXIMATE = 0.05
"""Standard deviation of what is known of a base point's coordinates, mm."""
SHORTEST = 80.0


def kinds() -> tuple[str, ...]:
    """The scenes' kinds."""
    return tuple(f"distances {structure}" for structure in STRUCTURES)


@dataclass(frozen=True)
class Distances:
    """A machine measured by distances, its base points fixed to the workpiece's table."""

    machine: Machine
    seed: int

    @classmethod
    def drawn(cls, seed: int, kind: str) -> Distances:
        """A scene by its seed and kind: ``distances`` and a key of `STRUCTURES`."""
        return cls(draw(seed, kind.split()[1]), seed)

    def causes(self) -> dict[str, Cause]:
        """One for each of `HIDDEN`."""
        rng = np.random.default_rng((self.seed, 11))
        base = f"B{1 + rng.integers(BASES)}"
        found = [
            Cause("length_bias", READING, _all, (("length_bias", {}),)),
            Cause(
                "length_bias of one base",
                READING,
                lambda s: np.asarray((np.asarray(s["base"]) == base) * 1.0),
                (("length_bias", {"base": base}),),
            ),
        ]
        return {c.name: c for c in found}

    def simulate(self, causes: Hidden, *, held_out: bool = False) -> Simulated:
        """Distances through a day, and those between the base points; held out, laser lines."""
        if held_out:
            return simulate(self.machine, self.seed, causes, held_out=True)
        rng = np.random.default_rng((self.seed, 0))
        travels = self.machine.travels
        low, high = (np.array([travels[a][k] for a in "XYZ"]) for k in (0, 1))
        corners = np.array([[0.1, 0.1, 0.05], [0.9, 0.15, 0.1], [0.5, 0.9, 0.05], [0.5, 0.5, 0.95]])
        corners = corners + rng.uniform(-0.05, 0.05, (BASES, 3))
        bases = low + corners * (high - low) + np.array(TOOLS[0])
        planner = _plan(rng, travels, bases)
        state, signals = conditions(planner, self.machine.axes, rng)
        names = [name.split("_")[0] for name in planner.rows.setup]
        tool = np.array(planner.rows.tool)
        number = np.array([int(name[1:]) - 1 for name in names])
        point = exact(self.machine, causes).point(state, tool)
        value = np.linalg.norm(point - bases[number], axis=1)
        pairs = list(combinations(range(BASES), 2))
        between = np.array([np.linalg.norm(bases[i] - bases[j]) for i, j in pairs])
        hidden = np.zeros(len(value) + len(pairs))
        state["base"] = np.array([*names, *(f"B{i + 1}" for i, _ in pairs)])
        state["between"] = np.arange(len(hidden)) >= len(value)
        for cause, size in causes:
            if cause.place == READING:
                hidden += size * cause.motion(state)
        value = np.concatenate([value, between])
        sd = NOISE + NOISE_LENGTH * value
        measured = value + hidden + sd * rng.standard_normal(len(value))
        known = bases + rng.normal(0.0, APPROXIMATE, bases.shape)
        return Simulated(_text(planner, state, signals, measured, sd, known, pairs), hidden)

    def model_text(self, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
        """Geometry and expansion, nothing fitted."""
        return model_text(self.machine, omits)


def _all(state: State) -> F64:
    return np.ones(len(np.asarray(state["base"])))


def _plan(rng: np.random.Generator, travels: dict[str, tuple[float, float]], bases: F64) -> Planner:
    """Random places from each base with each tool, never nearer than the bar's shortest length."""
    p = Planner(("X", "Y", "Z"), travels)
    for k, base in enumerate(bases):
        for j in range(2):
            tool = np.array(TOOLS[j])
            done = 0
            while done < PLACES:
                place = p.at(*rng.uniform(0.02, 0.98, 3))
                if np.linalg.norm(place + tool - base) > SHORTEST:
                    p.point(f"B{k + 1}_tool{j}", place, np.eye(3)[0], tool)
                    done += 1
            p.clock += 600.0
    return p


def _text(
    planner: Planner,
    state: dict[str, Any],
    signals: dict[str, F64],
    measured: F64,
    sd: F64,
    bases: F64,
    pairs: Sequence[tuple[int, int]],
) -> str:
    lines = ['# format = "abbe-campaign/1"', '# machine = "hidden"', '# instrument = "laser bar"']
    for k, base in enumerate(bases):
        lines += [f"# [bases.B{k + 1}]", f"# position = [{', '.join(f'{b:.4f}' for b in base)}]"]
    head = "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,tool_x,tool_y,tool_z,base,base2,value,sd"
    lines.append(",".join([head, *signals]))
    rows = planner.rows
    for i in range(len(rows.time)):
        fields = [f"{rows.time[i]:.1f}", rows.setup[i], "distance"]
        fields += [f"{state[a][i]:.4f}" for a in "XYZ"]
        fields += [f"{state[a + '_dir'][i]:.0f}" for a in "XYZ"]
        fields += [f"{v:g}" for v in rows.tool[i]]
        fields += [str(state["base"][i]), "", f"{measured[i]:.7f}", f"{sd[i]:.7f}"]
        lines.append(",".join([*fields, *(f"{s[i]:.3f}" for s in signals.values())]))
    for k, (one, two) in enumerate(pairs, start=len(rows.time)):
        fields = ["", "between", "base_distance", *[""] * 9, f"B{one + 1}", f"B{two + 1}"]
        fields += [f"{measured[k]:.7f}", f"{sd[k]:.7f}", *[""] * len(signals)]
        lines.append(",".join(fields))
    return "\n".join(lines) + "\n"
