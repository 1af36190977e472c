"""A ball plate as its certificate describes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_length import CalibratedLength
from abbe.compcore.artefacts.plate import rigid_placing

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CalibratedPlate:
    """Balls whose places are known.

    Attributes
    ----------
    points
        Names of the n balls.
    calibrated
        Their middles at 20 °C in the plate's own frame, shape (n, 3), mm.
    diameter
        Of the balls, mm.
    sd
        Standard uncertainty of a calibrated coordinate, mm.
    expansion
        1/K.
    """

    points: tuple[str, ...]
    calibrated: F64
    diameter: float
    sd: float = 0.0
    expansion: float = 0.0

    def at(self, temperature: float | None) -> F64:
        """The middles at a temperature (°C; None: 20 °C), shape (n, 3), mm."""
        return self.calibrated * CalibratedLength(1.0, expansion=self.expansion).at(temperature)

    def placed(self, numbers: list[int], indicated: F64, temperature: float | None) -> F64:
        """All middles where the plate stands, as some of its balls show it, (n, 3), mm.

        Parameters
        ----------
        numbers
            Indices of the balls that were measured, three or more.
        indicated
            Their middles, (m, 3), mm.
        """
        own = self.at(temperature)
        turn, shift = rigid_placing(own[numbers], indicated)
        return np.asarray(own @ turn.T + shift)

    def gauge(self, ball: int, direction: int) -> str:
        """What a row of a ball is measured against: the ball, and the plate's axis 0, 1, 2."""
        place = ", ".join(f"{v:.4f}" for v in self.calibrated[ball].tolist())
        return f"{self.points[ball]} ({place}) {'xyz'[direction]}"
