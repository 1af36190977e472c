"""The uncertainty of a test by its causes: instrument, thermal expansion, repeatability, set-up.

By the law of propagation (GUM, 5.1.2) with differences in place of derivatives: every input is
moved by its standard uncertainty, and the standard's own evaluation is done again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_length import CalibratedLength
from abbe.compcore.iso230.positioning import PositioningResult, Runs, evaluate_positioning

F64 = NDArray[np.float64]
Budget = Mapping[str, float]
"""Cause → its part of the standard uncertainty, mm or rad."""

FIGURES = ("A", "R", "E", "M", "B")
"""What is judged of a line (ISO 230-2)."""
INSTRUMENT = "instrument"
EXPANSION = "thermal expansion"
REPEATABILITY = "repeatability"
SETUP = "set-up"
CAUSES = (INSTRUMENT, EXPANSION, REPEATABILITY, SETUP)


@dataclass(frozen=True, slots=True)
class MeasuringUncertainty:
    """How sure the means of a test are; standard uncertainties (k = 1).

    Attributes
    ----------
    reading, angle
        Of one reading of a length, mm, and of an angle, rad.
    per_length
        Of the instrument's scale, mm/mm: its calibration, and the air for a laser.
    expansion, expansion_sd
        Coefficient of thermal expansion of what is measured, and its uncertainty, 1/K.
    temperature_sd
        Of its temperature, K.
    misalignment
        How far the instrument's line lies at most beside the axis's at its end, mm.
    """

    reading: float = 3e-4
    angle: float = 1e-6
    per_length: float = 5e-7
    expansion: float = 11.5e-6
    expansion_sd: float = 1e-6
    temperature_sd: float = 0.2
    misalignment: float = 0.5

    def of_length(
        self, length: float, temperature: float | None, line: float = 0.0
    ) -> dict[str, float]:
        """What a length (mm) at a temperature (°C; None: 20 °C) is unsure by, cause → mm.

        Thermal expansion as of any calibrated length (ISO/TS 23165). The instrument's line that
        lies up to R beside the axis's at the end of a line of length L shows it too short by up to
        R²/2L (cosine error), anywhere between alike: R²/2L/√12; a part of it by as much a part.

        Parameters
        ----------
        line
            The whole line's length, mm, of which it is a part; 0: it is the whole.
        """
        bare = CalibratedLength(length, 0.0, self.expansion, self.expansion_sd)
        whole = max(line, length)
        beside = length * self.misalignment**2 / (2.0 * whole**2) if whole > 0.0 else 0.0
        return {
            INSTRUMENT: self.per_length * length,
            EXPANSION: bare.uncertainty(temperature, self.temperature_sd),
            SETUP: beside / math.sqrt(12.0),
        }

    def of_turn(self) -> dict[str, float]:
        """What an angle over the whole travel of a rotary axis is unsure by, cause → rad."""
        return {INSTRUMENT: self.angle}


def combined(budget: Budget) -> float:
    """The combined standard uncertainty of independent causes.

    >>> combined({"instrument": 3.0, "set-up": 4.0})
    5.0
    """
    return math.sqrt(math.fsum(u * u for u in budget.values()))


def budgets_of(
    runs: Runs, causes: Mapping[str, float], reading: float
) -> dict[str, dict[str, float]]:
    """Figure → cause → standard uncertainty of a line's results, mm or rad.

    Parameters
    ----------
    causes
        What grows evenly along the line, cause → its amount at the far end.
    reading
        Of one reading, mm or rad; stands for the scatter of targets that were read once.

    Returns
    -------
    The figures that the runs give. Repeatability is what the means of few runs are unsure by,
    s/√n at each target: the scatter itself is in A and R by their definition.
    """
    result = evaluate_positioning(runs)
    known = [name for name in FIGURES if getattr(result, name) is not None]
    span = float(np.ptp(runs.targets)) or 1.0
    along = ((runs.targets - runs.targets[0]) / span)[:, None]
    found = {name: dict.fromkeys((*causes, REPEATABILITY), 0.0) for name in known}
    for cause, amount in causes.items():
        for name, u in _moved(runs, result, known, amount * along, amount * along).items():
            found[name][cause] = u
    square = dict.fromkeys(known, 0.0)
    nothing = np.zeros_like(along)
    sides = ((runs.up, result.s_up), (runs.down, result.s_down))
    for side, (table, scatter) in enumerate(sides):
        n = np.isfinite(table).sum(axis=1)
        s = np.where(np.isfinite(scatter), scatter, reading)
        for i in np.flatnonzero(n > 0).tolist():
            one = nothing.copy()
            one[i] = s[i] / math.sqrt(n[i])
            pair = (one, nothing) if side == 0 else (nothing, one)
            for name, u in _moved(runs, result, known, *pair).items():
                square[name] += u * u
    for name in known:
        found[name][REPEATABILITY] = math.sqrt(square[name])
    return found


def _moved(
    runs: Runs, result: PositioningResult, known: list[str], up: F64, down: F64
) -> dict[str, float]:
    """By how much each figure changes when the readings do, to the worse side."""
    worst = dict.fromkeys(known, 0.0)
    for sign in (1.0, -1.0):
        moved = evaluate_positioning(replace(runs, up=runs.up + sign * up,
                                             down=runs.down + sign * down))  # fmt: skip
        for name in known:
            change = abs(float(getattr(moved, name)) - float(getattr(result, name)))
            worst[name] = max(worst[name], change)
    return worst
