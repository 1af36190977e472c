"""Bare scenes: machines with few errors, and users who model no more than these.

What elsewhere another error motion of the model would imitate, stands alone here: a scale factor
where nothing else is known along the axis, a squareness where straightness is not modelled, a beam
that sags, a spindle that leans. The machine has none of what its user left out, but the hidden
cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import ExactMachine
from benchmarks.hidden.campaigns.campaign import STRUCTURES, Machine, draw, exact, model_text
from benchmarks.hidden.campaigns.measuring import Hidden, Simulated, measure
from benchmarks.hidden.campaigns.plan import Planner, calibration, check
from benchmarks.hidden.causes.cause import Cause, State, six

F64 = NDArray[np.float64]

MOUNT = " mount"
"""Behind an axis's name: a cause's place is how that axis is fixed."""

MODELLED: dict[str, tuple[str, ...]] = {
    "expansions": (),
    "positions": ("positioning",),
    "squared": ("positioning", "squareness"),
}
"""What a bare machine has and its user models beside the scales' expansion, by the scene's first
word."""

HIDDEN: dict[str, tuple[str, ...]] = {
    "positioning": ("expansions",),
    "scale": ("expansions",),
    "squareness": ("positions",),
    "overhang_sag": ("positions", "squared"),
    "spindle_squareness": ("positions", "squared"),
}
"""Cause → in which bare scenes it can be distinguished from what is modelled."""

LENGTHS = (-80.0, -120.0, -180.0, -250.0)
"""Lengths of the straight tools that meet the same ball one after the other, mm."""

_GEOMETRY = ("positioning", "straightness", "angular", "squareness")


def kinds(words: Sequence[str]) -> tuple[str, ...]:
    """The scenes' kinds for some first words, over all structures."""
    return tuple(f"{word} {structure}" for structure in STRUCTURES for word in words)


@dataclass(frozen=True)
class Bare:
    """A machine with few errors, and the user who knows these."""

    machine: Machine
    modelled: tuple[str, ...]
    seed: int

    @classmethod
    def drawn(cls, seed: int, kind: str) -> Bare:
        """A scene by its seed and kind: a key of `MODELLED` and one of `STRUCTURES`."""
        word, structure = kind.split()
        modelled = MODELLED[word]
        whole = draw(seed, structure)
        waves = {}
        for axis, own in whole.waves.items():
            has = np.zeros(6)
            has["XYZ".index(axis)] = "positioning" in modelled
            waves[axis] = np.stack([own[0] * has[:, None], own[1], own[2]])
        square = "squareness" not in modelled
        mounts = {a: (0.0,) * 6 if square else mount for a, mount in whole.mounts.items()}
        # turned about its own travel the last axis stands as square, but its spindle leans
        last = whole.axes[-1]
        own_turn = 3 + "XYZ".index(last)
        mounts[last] = tuple(0.0 if k == own_turn else v for k, v in enumerate(mounts[last]))
        return cls(replace(whole, waves=waves, mounts=mounts), modelled, seed)

    def causes(self) -> dict[str, Cause]:
        """One for each key of `HIDDEN`."""
        rng = np.random.default_rng((self.seed, 9))
        return {c.name: c for c in _causes(self.machine, rng)}

    def simulate(self, causes: Hidden, *, held_out: bool = False) -> Simulated:
        """Lines by laser, angles by level, and tools of several lengths on one ball."""
        rng = np.random.default_rng((self.seed, int(held_out)))
        axes = ("X", "Y", "Z")
        if held_out:
            planner = check(rng, axes, self.machine.travels)
        else:
            planner = calibration(axes, self.machine.travels)
        for cycle in range(3):
            _tools(planner, cycle)
        return measure(partial(_exact, self.machine), self.machine.axes, planner, rng, causes)

    def model_text(self, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
        """What the machine has."""
        lacking: list[tuple[str, Mapping[str, Any]]] = [
            (kind, {}) for kind in _GEOMETRY if kind not in self.modelled
        ]
        return model_text(self.machine, [*omits, *lacking])


def _tools(planner: Planner, cycle: int) -> None:
    """One ball met by tools of several lengths; the zero is common to all."""
    ball = planner.at(0.5, 0.5, 0.55)
    for k in range(3):
        planner.master()
        name = f"c{cycle}_tools_{'xyz'[k]}"
        for length in (*LENGTHS, *LENGTHS[::-1]):
            tool = np.array([0.0, 0.0, length])
            place = ball - np.array([0.0, 0.0, length - LENGTHS[1]])
            planner.point(name, place, np.eye(3)[k], tool)


def _exact(machine: Machine, causes: Hidden) -> ExactMachine:
    """The exact chain, with causes in the error motions and in the mounts."""
    mounts = {axis: np.array(mount) for axis, mount in machine.mounts.items()}
    at_once = {"t": np.zeros(1)}
    for cause, size in causes:
        if cause.place.endswith(MOUNT):
            mounts[cause.place.removesuffix(MOUNT)] += size * cause.motion(at_once)[0]
    fixed = {axis: tuple(map(float, mount)) for axis, mount in mounts.items()}
    return exact(replace(machine, mounts=fixed), causes)


def _causes(machine: Machine, rng: np.random.Generator) -> list[Cause]:
    axes, travels = machine.axes, machine.travels
    on_table = [w[0] for w in machine.structure.split() if w.endswith("'")]
    a = axes[int(rng.integers(3))]
    low, high = travels[a]
    along = "XYZ".index(a)
    amplitude = rng.normal(0.0, 1.0, 3) * np.array([1.0, 0.6, 0.4])
    cycles, phase = rng.uniform([0.3, 0.7, 1.2], [0.6, 1.1, 1.6]), rng.uniform(0.0, 6.28, 3)
    one, two = sorted(rng.choice(3, 2, replace=False))
    first, second = axes[one], axes[two]
    (third,) = set("XYZ") - {first, second}
    # what is fixed askew is all that stands behind the first of the two axes' moves
    askew = first if first in on_table else second
    lean = "XY"[int(rng.integers(2))]
    last = axes[-1]
    across = [d for d in "XYZ" if d != last][int(rng.integers(2))]
    if last == "Y":
        across = "Z"  # a ram that reaches along Y lies level, and what it holds up bends it down

    def division(s: State) -> F64:
        x = (np.asarray(s[a]) - low) / (high - low)
        return np.asarray((amplitude * np.sin(2.0 * np.pi * cycles * x[:, None] + phase)).sum(1))

    return [
        Cause(
            "positioning",
            a,
            lambda s: six(s, along, division(s)),
            (("positioning", {"axis": a, "shape": "spline:8"}), ("positioning", {"axis": a})),
        ),
        Cause(
            "scale",
            a,
            lambda s: six(s, along, np.asarray(s[a]) / (high - low)),
            (("scale", {"axis": a}),),
        ),
        Cause(
            "squareness",
            askew + MOUNT,
            lambda s: six(s, 3 + "XYZ".index(third), np.ones(1)),
            (("squareness", {"axes": [first, second]}),),
            size=5e-6,
        ),
        Cause(
            "overhang_sag",
            last,
            partial(_cantilever, travel=travels[last], reach=last, down=across),
            (("overhang_sag", {"axis": last, "direction": across, "by": last}),),
        ),
        Cause(
            "spindle_squareness",
            last,
            lambda s: six(s, {"X": 4, "Y": 3}[lean], np.ones(len(np.asarray(s["t"])))),
            (("spindle_squareness", {"direction": lean}),),
            size=5e-6,
        ),
    ]


def _cantilever(state: State, travel: tuple[float, float], reach: str, down: str) -> F64:
    """A beam that is clamped where it begins and loaded at its end: it deflects and slopes."""
    root = min(travel, key=abs)
    outward = 1.0 if root == travel[0] else -1.0
    whole = travel[1] - travel[0]
    part = np.abs(np.asarray(state[reach]) - root) / whole
    beam = np.eye(3)["XYZ".index(reach)] * outward
    sag = np.eye(3)["XYZ".index(down)]
    out = np.zeros((len(part), 6))
    out[:, :3] = part[:, None] ** 3 * sag
    # load F at length L: F·L³/(3EI) and F·L²/(2EI)
    out[:, 3:] = (1.5 * part**2 / whole)[:, None] * np.cross(beam, sag)
    return out
