"""The simulated moving-bridge CMM: which errors it has, drawn from a seed.

Modelled on the machine of Zhang, Veale, Charlton, Borchardt and Hocken (CIRP Annals 34/1, 1985):
structure ``w b Y X Z t``, 700 × 900 × 360 mm, 18 smooth error motions, three squarenesses, scales
whose effective expansion is some 16, 10 and 13 ppm/K of the mean of two thermistors each, and
a largest volumetric error of 29.4 µm at 20 °C. No backlash, no elastic effects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from abbe.drivers.simulated.bridge.shapes import SmoothMotions, random_motions
from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine, SixErrors, State

Array = NDArray[np.float64]

STRUCTURE: Final = "w b Y X Z t"
AXES: Final = ("X", "Y", "Z")
TRAVELS: Final[Mapping[str, tuple[float, float]]] = {
    "X": (0.0, 700.0),
    "Y": (0.0, 900.0),
    "Z": (-360.0, 0.0),
}
"""mm."""

SCALE_SENSORS: Final[Mapping[str, tuple[str, str]]] = {
    "X": ("T_x1", "T_x2"),
    "Y": ("T_y1", "T_y2"),
    "Z": ("T_z1", "T_z2"),
}
"""The two thermistors on each axis's scale."""

PLACES: Final = (*(name for pair in SCALE_SENSORS.values() for name in pair), "T_amb")
"""All temperature sensors, in the order of registers and columns."""

REFERENCE_TEMPERATURE: Final = 20.0
"""°C: where scales are right."""

TOOL: Final = (0.0, 0.0, -150.0)
"""Offset of the probe tip that the simulated machine carries, mm."""

VOLUMETRIC_ERROR: Final = 29.4e-3
"""Largest error in the volume with `TOOL` at 20 °C, mm (Zhang et al.)."""

_MICRO: Final = 1e-6


@dataclass(frozen=True)
class BridgeMachine:
    """One bridge CMM: the exact chain and what its errors are made of.

    Attributes
    ----------
    exact
        The exact machine; its state holds X, Y, Z (mm) and every place of `PLACES` (°C).
    motions
        The six error motions per axis.
    squareness
        Right-handed rotations (rad): of the X guideway about z on Y, and of the Z guideway about y
        and about x on X.
    expansion
        Effective expansion of the scales, 1/K.
    sensor_errors
        What the thermistors of `PLACES` read too much, K; constant, never calibrated away.
    """

    exact: ExactMachine
    motions: Mapping[str, SmoothMotions]
    squareness: tuple[float, float, float]
    expansion: Mapping[str, float]
    sensor_errors: Array

    def state(self, position: ArrayLike, temperatures: ArrayLike) -> State:
        """State at positions (..., 3) in mm and temperatures (..., 7) in °C of `PLACES`."""
        p, t = np.asarray(position, dtype=float), np.asarray(temperatures, dtype=float)
        state = {name: p[..., i] for i, name in enumerate(AXES)}
        return state | {name: t[..., i] for i, name in enumerate(PLACES)}

    def error(self, position: ArrayLike, temperatures: ArrayLike, tool: ArrayLike = TOOL) -> Array:
        """Error (actual − indicated) of the probe tip, mm, shape (..., 3)."""
        return self.exact.error(self.state(position, temperatures), tool)


def uniform(temperature: float) -> Array:
    """All places at one temperature (°C)."""
    return np.full(len(PLACES), float(temperature))


def volume_grid(points: int) -> Array:
    """A grid over the whole volume with so many points along each axis, mm, shape (n, 3)."""
    along = [np.linspace(*TRAVELS[name], points) for name in AXES]
    return np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3)


def make_bridge(seed: int) -> BridgeMachine:
    """Draw a machine; the same seed gives the same machine.

    Positioning 4 to 9 µm and its scale's mean error up to 12 µm, straightness 2 to 5 µm, angles
    10 to 25 µrad, all peak to peak over the travel, squarenesses 6 to 20 µrad; then all of it
    scaled together for `VOLUMETRIC_ERROR`. Every error motion is 0 at position 0 of its axis, and
    straightness has no mean slope: what is left of it is squareness.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 1985]))
    motions = {}
    for own, name in enumerate(AXES):
        span = np.concatenate([rng.uniform(2.0, 5.0, 3), rng.uniform(10.0, 25.0, 3)]) * np.array(
            [1e-3] * 3 + [_MICRO] * 3
        )
        span[own] = rng.uniform(4.0, 9.0) * 1e-3
        slope = np.zeros(6)
        slope[own] = rng.choice([-1.0, 1.0]) * rng.uniform(4.0, 12.0) * 1e-3
        slope[3:] = rng.uniform(-0.6, 0.6, 3) * span[3:]
        motions[name] = random_motions(rng, TRAVELS[name], span, slope, zero_at=0.0)
    square = rng.choice([-1.0, 1.0], 3) * rng.uniform(6.0, 20.0, 3) * _MICRO
    expansion = {
        name: ppm * _MICRO * (1.0 + 0.05 * rng.uniform(-1.0, 1.0))
        for name, ppm in zip(AXES, (16.0, 10.0, 13.0), strict=True)
    }
    sensor_errors = rng.normal(0.0, 0.02, len(PLACES))

    machine = _assemble(motions, square, expansion, sensor_errors)
    grid, cold = volume_grid(9), uniform(REFERENCE_TEMPERATURE)
    factor = VOLUMETRIC_ERROR / float(np.max(np.linalg.norm(machine.error(grid, cold), axis=-1)))
    return _assemble(
        {name: motion.scaled(factor) for name, motion in motions.items()},
        square * factor,
        expansion,
        sensor_errors,
    )


def _assemble(
    motions: Mapping[str, SmoothMotions],
    square: Array,
    expansion: Mapping[str, float],
    sensor_errors: Array,
) -> BridgeMachine:
    mounts = {
        "Y": (0.0,) * 6,
        "X": (0.0, 0.0, 0.0, 0.0, 0.0, float(square[0])),
        "Z": (0.0, 0.0, 0.0, float(square[2]), float(square[1]), 0.0),
    }
    axes = {
        name: ExactAxis(
            error=_errors(name, motions[name]),
            actual=_scale(name, expansion[name]),
            mount=mounts[name],
        )
        for name in AXES
    }
    return BridgeMachine(
        ExactMachine(STRUCTURE, axes, TRAVELS),
        motions,
        (float(square[0]), float(square[1]), float(square[2])),
        expansion,
        sensor_errors,
    )


def _errors(name: str, motions: SmoothMotions) -> SixErrors:
    return lambda state: motions(state[name])


def _scale(name: str, expansion: float) -> Callable[[State], Array]:
    """How far an axis goes when its scale, marked at 20 °C, has another temperature."""
    one, other = SCALE_SENSORS[name]

    def actual(state: State) -> Array:
        mean = 0.5 * (np.asarray(state[one]) + np.asarray(state[other]))
        stretch = 1.0 + expansion * (mean - REFERENCE_TEMPERATURE)
        reached: Array = np.asarray(state[name], dtype=float) * stretch
        return reached

    return actual
