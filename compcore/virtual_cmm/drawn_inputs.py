"""The inputs of a virtual measurement, drawn: each draw from numbers of its own, by its number.

The numbers of draw i come from ``SeedSequence(seed, spawn_key=(i,))``: they are the same whoever
draws them, in whatever order and company.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.virtual_cmm.part_program import PartProgram

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DrawnInputs:
    """What d draws take, in standard units: normal with sd 1, or even between −1 and 1.

    Attributes
    ----------
    parameters
        Normal, (d, p): for the model's parameters.
    sensors
        Normal, (d, s): for the sensors' calibrations, in the order of the program's signals.
    varied
        Even, (d, s): where in its range each signal is.
    outside
        Even, (d,): for what lies outside of what was measured.
    warmth
        Normal, (d, 2): the part's temperature and expansion.
    tips
        Normal, (d, t): the styli's radii.
    lobes
        Even, (d,): orientation of the probe's lobes, in half turns.
    touches
        Normal, (d, n): of every touch.
    surface
        Normal, (d, n): of the surface where it is touched.
    sides
        Even, (d, n, 3): from where axes came that the approach does not move.
    """

    parameters: F64
    sensors: F64
    varied: F64
    outside: F64
    warmth: F64
    tips: F64
    lobes: F64
    touches: F64
    surface: F64
    sides: F64


def draw(program: PartProgram, parameters: int, seed: int, numbers: range) -> DrawnInputs:
    """Draw the inputs of some draws.

    Parameters
    ----------
    parameters
        How many parameters the model has.
    seed
        Of the whole run.
    numbers
        Which draws.
    """
    s, t, n = len(program.signals), len(program.styli), len(program.points)
    normal = np.empty((len(numbers), parameters + s + 2 + t + 2 * n))
    even = np.empty((len(numbers), s + 2 + 3 * n))
    for row, number in enumerate(numbers):
        own = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        normal[row] = own.standard_normal(normal.shape[1])
        even[row] = own.uniform(-1.0, 1.0, even.shape[1])
    sizes = np.cumsum([parameters, s, 2, t, n])
    theta, sensors, warmth, tips, touches, surface = np.split(normal, sizes, axis=1)
    varied, outside, lobes, sides = np.split(even, np.cumsum([s, 1, 1]), axis=1)
    return DrawnInputs(
        theta, sensors, varied, outside[:, 0], warmth, tips, lobes[:, 0], touches, surface,
        sides.reshape(len(numbers), n, 3),
    )  # fmt: skip
