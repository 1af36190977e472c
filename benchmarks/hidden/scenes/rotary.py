"""Machines with rotary axes: drawn, measured on balls at many angles, modelled by their users.

The linear axes are compensated already: scale, squareness and expansion are all that their users
still model. Of every rotary axis they model the location of its line and the positioning, of the
one that turns fully all error motions: those of an axis that only tilts have no full waves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine, rotation
from benchmarks.hidden.campaigns.campaign import effect_text, machine_text, signals_text
from benchmarks.hidden.campaigns.measuring import Hidden, Simulated, measure
from benchmarks.hidden.campaigns.rotary_plan import LAYOUTS, Layout, calibration, check
from benchmarks.hidden.causes import rotary as rotary_causes
from benchmarks.hidden.causes.cause import Cause, six

F64 = NDArray[np.float64]

LOBES = (1, 2, 3)
"""Waves of an error motion in a turn; the third is too small for a model to need it."""


@dataclass(frozen=True)
class Rotary:
    """A machine with rotary axes on one day.

    Attributes
    ----------
    layout
        Which machine.
    mounts, expansion, scale
        Of the linear axes: three translations and rotations (mm, rad), 1/K, unit-free.
    constants, waves
        Of the rotary axes, as the stator sees them: six constants; cosine and sine amplitudes of
        six motions in `LOBES` waves, (6, 3, 2). mm, rad.
    seed
        Of the machine and the day.
    """

    layout: Layout
    mounts: Mapping[str, tuple[float, ...]]
    expansion: Mapping[str, float]
    scale: Mapping[str, float]
    constants: Mapping[str, F64]
    waves: Mapping[str, F64]
    seed: int

    @classmethod
    def drawn(cls, seed: int, kind: str) -> Rotary:
        """A scene by its seed and kind, a key of `LAYOUTS`."""
        rng = np.random.default_rng(seed)
        layout = LAYOUTS[kind]
        constants, waves = {}, {}
        for axis in layout.axes[3:]:
            own = "ABC".index(axis)
            across = np.array([float(k != own) for k in range(3)])
            # the place and the lean of the line; its zero angle is the workpiece's
            constants[axis] = np.r_[rng.normal(0.0, 8e-3, 3) * across, rng.normal(0.0, 20e-6, 3)]
            constants[axis][3:] *= across
            size = np.r_[[1.5e-3] * 3, [6e-6] * 3][:, None, None]
            falling = np.array([1.0, 0.6, 0.02])[:, None]
            waves[axis] = rng.normal(size=(6, 3, 2)) * size * falling
            if axis != layout.swept:
                waves[axis][[k for k in range(6) if k != 3 + own]] = 0.0
        return cls(
            layout,
            {a: (0.0, 0.0, 0.0, *rng.normal(0.0, 15e-6, 3)) for a in "XYZ"},
            {a: float(rng.uniform(7e-6, 16e-6)) for a in "XYZ"},
            {a: float(rng.normal(0.0, 5e-6)) for a in "XYZ"},
            constants,
            waves,
            seed,
        )

    def causes(self) -> dict[str, Cause]:
        """All of `rotary_causes`."""
        rng = np.random.default_rng((self.seed, 9))
        return rotary_causes.causes(self.layout, rng)

    def simulate(self, causes: Hidden, *, held_out: bool = False) -> Simulated:
        """Lines and diagonals by laser, balls at many angles."""
        rng = np.random.default_rng((self.seed, int(held_out)))
        planner = (check if held_out else calibration)(self.layout, rng)
        own = self._without([cause for cause, _ in causes])
        return measure(partial(_exact, own), self._linear, planner, rng, causes)

    @property
    def _linear(self) -> tuple[str, ...]:
        """The linear axes, workpiece to tool."""
        return tuple(w[0] for w in self.layout.structure.split() if w[0] in "XYZ")

    def _without(self, causes: Sequence[Cause]) -> Rotary:
        """The same machine, silent in what causes bring in place of it."""
        constants = {a: c.copy() for a, c in self.constants.items()}
        waves = {a: w.copy() for a, w in self.waves.items()}
        for cause in causes:
            if cause.omits is None:
                continue
            kind, where = cause.omits
            axis = str(where["axis"])
            if kind == "rotary_location":
                constants[axis][:] = 0.0
            else:
                waves[axis][_component(kind, where)] = 0.0
        return replace(self, constants=constants, waves=waves)

    def model_text(self, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
        """The linear axes' scale, squareness, expansion; all of the rotary axes; nothing fitted."""
        layout = self.layout
        lines = machine_text(layout.structure, {a: layout.travels[a] for a in "XYZ"})
        for axis, place in layout.locations.items():
            low, high = np.rad2deg(layout.travels[axis])
            lines += [f"[machine.axes.{axis}]", f"travel = [{low:.6f}, {high:.6f}]"]
            lines += [f"location = {list(place)}"]
        lines += signals_text(self._linear)
        for kind, where in self._modelled():
            if not any(k == kind and where.items() >= w.items() for k, w in omits):
                lines += effect_text(kind, where)
        return "\n".join(lines) + "\n"

    def _modelled(self) -> Iterator[tuple[str, dict[str, Any]]]:
        linear = self._linear
        for axis in linear:
            yield "scale", {"axis": axis}
            yield "scale_expansion", {"axis": axis, "signals": [f"T_{axis.lower()}"]}
        for i, one in enumerate(linear):
            for two in linear[i + 1 :]:
                yield "squareness", {"axes": [one, two]}
        for axis in self.layout.axes[3:]:
            yield "rotary_location", {"axis": axis}
            yield "rotary_positioning", {"axis": axis}
            if axis != self.layout.swept:
                continue
            yield "rotary_axial", {"axis": axis}
            for kind in ("rotary_radial", "rotary_tilt"):
                for k, direction in enumerate("XYZ"):
                    if k != "ABC".index(axis):
                        yield kind, {"axis": axis, "direction": direction}


def _component(kind: str, where: Mapping[str, Any]) -> int:
    """Which of the six motions an effect of a rotary axis is."""
    own = "ABC".index(str(where["axis"]))
    across = "XYZ".find(str(where.get("direction")))
    return {
        "rotary_positioning": 3 + own,
        "rotary_axial": own,
        "rotary_radial": across,
        "rotary_tilt": 3 + across,
    }[kind]


def _exact(machine: Rotary, causes: Hidden) -> ExactMachine:
    """The exact chain of a machine with causes hidden in it."""
    layout = machine.layout
    words = [w for w in layout.structure.split() if w[0] in "XYZABC"]
    axes = {}
    for word in words:
        name, last = word[0], word == words[-1]
        at_tool = [(c, size) for c, size in causes if last and c.place == rotary_causes.SPINDLE]
        own = [(c, size) for c, size in causes if c.place == name]
        if name in "XYZ":
            error = partial(_linear_motions, machine, name, own + at_tool)
            axes[name] = ExactAxis(error=error, mount=machine.mounts[name])
        else:
            sense = 1.0 if word.endswith("'") else -1.0
            error = partial(_rotary_motions, machine, name, sense, own, at_tool)
            axes[name] = ExactAxis(error=error, location=layout.locations[name])
    return ExactMachine(layout.structure, axes)


def _linear_motions(machine: Rotary, axis: str, causes: Hidden, state: dict[str, Any]) -> F64:
    warmth = state[f"T_{axis.lower()}"] - 20.0
    grown = state[axis] * (machine.scale[axis] + machine.expansion[axis] * warmth)
    total = six(state, "XYZ".index(axis), grown)
    return total + sum(size * cause.motion(state) for cause, size in causes)


def _rotary_motions(
    machine: Rotary,
    axis: str,
    sense: float,
    causes: Hidden,
    at_tool: Hidden,
    state: dict[str, Any],
) -> F64:
    """Error motions as the chain takes them: in the rotor's own axes.

    They are written down as the stator sees them. An axis on the workpiece side comes in the chain
    with its rotor first: what the stator sees has turned by the angle; on the tool side by the
    opposite angle (`sense`).
    """
    angle = np.asarray(state[axis])
    phase = angle[:, None] * np.array(LOBES)
    waves = machine.waves[axis]
    total = machine.constants[axis] + np.cos(phase) @ waves[:, :, 0].T
    total = total + np.sin(phase) @ waves[:, :, 1].T
    total = total + sum(size * cause.motion(state) for cause, size in causes)
    turn = np.zeros((len(angle), 3))
    turn[:, "ABC".index(axis)] = sense * angle
    turned = rotation(turn)
    seen = [np.einsum("nij,nj->ni", turned, total[:, k : k + 3]) for k in (0, 3)]
    return np.hstack(seen) + sum(size * cause.motion(state) for cause, size in at_tool)
