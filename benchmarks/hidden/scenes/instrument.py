"""Scenes in which the measuring itself may err, so that a campaign can show it.

A laser that stays where it is all day and is zeroed once, in air whose pressure falls; lines that
are all read against one zero; a ball plate on a fixture; one thermometer for all three scales.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine
from benchmarks.hidden.campaigns.campaign import STRUCTURES, Machine, draw, exact, model_text
from benchmarks.hidden.campaigns.measuring import Hidden, Simulated, measure
from benchmarks.hidden.campaigns.plan import TOOLS, Planner, calibration, check
from benchmarks.hidden.causes.cause import POINT, READING, SENSOR, Cause, State, six

F64 = NDArray[np.float64]

HIDDEN: dict[str, tuple[str, ...]] = {
    "dead_path": ("laser",),
    "setup_zero": ("common",),
    "setup_slope": ("common",),
    "setup_frame": ("plate",),
    "setup_scale": ("plate",),
    "sensor_offset": ("thermometer",),
    "formula": ("laser", "plate"),
}
"""Cause → the scenes in which it may be hidden, by their first words."""

WORDS = ("laser", "common", "plate", "thermometer")
STANDS = "xy"
"""Axes along which a laser stands all day."""
PLATES = 4
ALIGNED = 0.3
"""Difference of temperatures in the column at which the machine was aligned, K."""


def kinds(words: Sequence[str]) -> tuple[str, ...]:
    """The scenes' kinds for some first words, over all structures."""
    return tuple(f"{word} {structure}" for structure in STRUCTURES for word in words)


@dataclass(frozen=True)
class Measured:
    """A machine and the way in which it is measured."""

    machine: Machine
    way: str
    seed: int

    @classmethod
    def drawn(cls, seed: int, kind: str) -> Measured:
        """A scene by its seed and kind: one of `WORDS` and a key of `STRUCTURES`."""
        way, structure = kind.split()
        machine = draw(seed, structure)
        if way == "thermometer":  # scales without error at 20 °C
            waves = {a: own.copy() for a, own in machine.waves.items()}
            for axis, own in waves.items():
                own[0, "XYZ".index(axis)] = 0.0
            machine = replace(machine, waves=waves)
        return cls(machine, way, seed)

    def causes(self) -> dict[str, Cause]:
        """One for each key of `HIDDEN`."""
        rng = np.random.default_rng((self.seed, 10))
        return {c.name: c for c in _causes(self.machine, rng)}

    def simulate(self, causes: Hidden, *, held_out: bool = False) -> Simulated:
        """The day's campaign in the scene's way; held out, lines by a laser with its own zeros."""
        rng = np.random.default_rng((self.seed, int(held_out)))
        axes, travels = ("X", "Y", "Z"), self.machine.travels
        if held_out:
            planner = check(rng, axes, travels)
        else:
            planner = calibration(axes, travels, _stands if self.way == "laser" else _nothing)
        if not held_out and self.way == "plate":
            _plates(planner)
        if not held_out and self.way == "common":
            _commonly(planner)
        chain = partial(_one_body if self.way == "thermometer" else exact, self.machine)
        weather = self.way == "laser"
        return measure(chain, self.machine.axes, planner, rng, causes, weather=weather)

    def model_text(self, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
        """What the machine has."""
        if self.way == "laser":
            text = model_text(self.machine, omits)
            return f'{text}[machine.signals.P_air]\nunit = "hPa"\nrole = "air"\n'
        if self.way != "thermometer":
            return model_text(self.machine, omits)
        text = model_text(self.machine, [*omits, ("positioning", {})])
        for axis in "yz":
            text = text.replace(f'signals = ["T_{axis}"]', 'signals = ["T_x"]')
        return text


def _one_body(machine: Machine, causes: Hidden) -> ExactMachine:
    """The exact chain; all scales are as warm as that of X."""
    whole = exact(machine, causes)

    def motions(axis: ExactAxis, state: State) -> F64:
        warmth = {"T_y": state["T_x"], "T_z": state["T_x"]}
        return np.asarray(axis.error(dict(state) | warmth)) if axis.error else np.zeros(6)

    axes = {a: replace(axis, error=partial(motions, axis)) for a, axis in whole.axes.items()}
    return ExactMachine(whole.structure, axes)


def _nothing(planner: Planner) -> None:
    """Nothing but the calibration."""


def _stands(planner: Planner) -> None:
    """The lines of lasers that stay where they are; their zeros are the first reading's."""
    for letter in STANDS:
        a = "xyz".index(letter)
        low, high = [0.3] * 3, [0.3] * 3
        low[a], high[a] = 0.02, 0.98
        planner.line(f"stand_{letter}", planner.at(*low), planner.at(*high), np.eye(3)[a])


def _commonly(planner: Planner) -> None:
    """All displacements are read against one zero, straightness against an aligned edge."""
    kind = dict(zip(planner.rows.setup, planner.rows.kind, strict=True))
    for name, free in planner.free.items():
        if kind[name] == "displacement":
            planner.free[name] = ["zero"] if "slope" in free else []


def _plates(planner: Planner) -> None:
    """A plate of balls in several places of a fixture that is aligned to the machine."""
    for k in range(PLATES):
        name = f"plate_{k + 1}"
        for p in np.linspace(0.1, 0.9, 5):
            for q in np.linspace(0.1, 0.9, 4):
                # level in two places, upright in the others
                where = ((p, q, 0.2 + 0.6 * (k // 2)), (p, 0.2 + 0.6 * (k // 2), q))[k % 2]
                for u in np.eye(3):
                    planner.point(name, planner.at(*where), u, np.array(TOOLS[0]))
        planner.free[name] = []


def _causes(machine: Machine, rng: np.random.Generator) -> list[Cause]:
    travels = machine.travels
    centre = {a: 0.5 * sum(travels[a]) for a in "XYZ"}
    half = {a: 0.5 * (travels[a][1] - travels[a][0]) for a in "XYZ"}
    stand = f"stand_{STANDS[int(rng.integers(len(STANDS)))]}"
    line = f"c{rng.integers(3)}_diag{2 * rng.integers(5)}"
    a, b = rng.permutation(3)[:2]
    edge = f"c{rng.integers(3)}_{'xyz'[a]}_str{'xyz'[b]}"
    plate = f"plate_{1 + rng.integers(PLATES)}"
    move, turn = rng.normal(0.0, 1.0, 3), rng.normal(0.0, 1.0, 3)
    one, two = rng.permutation(list("XYZ"))[:2]
    d = "XYZ"[int(rng.integers(3))]

    def scaled(s: State, axis: str) -> F64:
        return np.asarray((s[axis] - centre[axis]) / half[axis])

    def written(axis: str) -> str:
        return f"(({axis}-({centre[axis]:g}))/{half[axis]:g})"

    def gradient(s: State) -> F64:
        return np.asarray(s["T_col_front"] - s["T_col_rear"] - ALIGNED)

    return [
        Cause(
            "dead_path",
            READING,
            lambda s: _of(s, stand) * (_index(s) - _first(s, stand, _index(s))),
            (("dead_path", {"setups": [stand]}),),
            size=1e3,
        ),
        Cause("setup_zero", READING, lambda s: _of(s, line), (("setup_zero", {"setup": line}),)),
        Cause(
            "setup_slope",
            READING,
            lambda s: _of(s, edge) * scaled(s, "XYZ"[a]),
            (("setup_slope", {"setup": edge}),),
        ),
        Cause(
            "setup_frame",
            READING,
            lambda s: _of(s, plate) * _tipped(s, move, turn / 300.0),
            (("setup_frame", {"setup": plate}),),
        ),
        Cause(
            "setup_scale",
            READING,
            lambda s: _of(s, plate) * _grown(s, plate),
            (("setup_scale", {"setup": plate}),),
            size=1e-5,
        ),
        Cause(
            "sensor_offset",
            SENSOR,
            lambda s: np.ones(len(np.asarray(s["t"]))),
            (("sensor_offset", {"signal": "T_x"}),),
            depends=("T_x",),
            size=0.1,
        ),
        Cause(
            "formula",
            POINT,
            lambda s: six(s, "XYZ".index(d), scaled(s, one) * scaled(s, two) * gradient(s)),
            depends=(one, two, "T_col_front", "T_col_rear"),
            formula=(
                f"d{d}",
                (f"{written(one)}*{written(two)}*(T_col_front-T_col_rear-{ALIGNED})",),
            ),
        ),
    ]


def _of(state: State, setup: str) -> F64:
    """1 on the rows of a set-up."""
    return np.asarray(np.asarray(state["setup"]) == setup, dtype=np.float64)


def _first(state: State, setup: str, values: F64) -> float:
    """A value at the set-up's first row; 0 where it was not measured."""
    rows = np.flatnonzero(_of(state, setup))
    return float(values[rows[0]]) if rows.size else 0.0


def _index(state: State) -> F64:
    """Refractive index of air, less 1: the shop-floor formula of NIST's Engineering Metrology
    Toolbox, kPa, °C, at 50 % of humidity; at a standard pressure where none is recorded.
    """
    t, p = np.asarray(state["T_amb"]), 0.1 * np.asarray(state.get("P_air", 1013.25))
    return np.asarray(7.86e-4 * p / (273.0 + t) - 1.5e-11 * 50.0 * (t**2 + 160.0))


def _grown(state: State, setup: str) -> F64:
    """What a plate reads that is larger than believed and held in its middle, (n,) mm.

    Where its balls truly are, the machine says they are nearer to the middle.
    """
    at = np.stack([np.asarray(state[a]) for a in "XYZ"], axis=1)
    own = _of(state, setup) > 0.0
    middle = 0.5 * (at[own].min(axis=0) + at[own].max(axis=0)) if own.any() else np.zeros(3)
    return np.asarray(-((at - middle) * np.asarray(state["u"])).sum(axis=1))


def _tipped(state: State, move: F64, turn: F64) -> F64:
    """What a plate reads that lies a little elsewhere: moved (mm) and turned (rad), (n,) mm."""
    at = np.stack([np.asarray(state[a]) for a in "XYZ"], axis=1)
    # a chip under one foot turns the plate about another
    foot = at.min(axis=0)
    angle = float(np.linalg.norm(turn)) * 1e-6
    axis = turn / np.linalg.norm(turn)
    arm = at - foot
    turned = np.cos(angle) * arm + np.sin(angle) * np.cross(axis, arm)
    turned += (1.0 - np.cos(angle)) * (arm @ axis)[:, None] * axis
    place = (turned - arm) * 1e6 + move
    return np.asarray((place * np.asarray(state["u"])).sum(axis=1))
