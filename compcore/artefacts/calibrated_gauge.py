"""A gauge block or step gauge as its certificate describes it: parallel faces on one line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_length import CalibratedLength

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CalibratedGauge:
    """Steps one behind the other, each between two faces; a gauge block is one step.

    Attributes
    ----------
    faces
        Names of the n faces, in their order.
    places
        Where they are at 20 °C along the gauge, from the first one, shape (n,), mm.
    width, height
        Of the steps, across the gauge and along the stylus, mm.
    sd
        Standard uncertainty of a calibrated place, mm.
    expansion
        1/K.
    """

    faces: tuple[str, ...]
    places: F64
    width: float
    height: float
    sd: float = 0.0
    expansion: float = 0.0

    @property
    def sides(self) -> F64:
        """To which side the faces look, −1 or 1 along the gauge, shape (n,)."""
        return np.where(np.arange(len(self.faces)) % 2 == 0, -1.0, 1.0)

    @property
    def steps(self) -> F64:
        """Beginning and end of every step, shape (n/2, 2), mm."""
        return np.asarray(self.places.reshape(-1, 2))

    @property
    def gap(self) -> float:
        """The narrowest room between two steps, mm; infinite where there is only one."""
        return float((self.steps[1:, 0] - self.steps[:-1, 1]).min(initial=np.inf))

    @property
    def length(self) -> float:
        """From the first face to the last, mm."""
        return float(self.places[-1])

    def at(self, temperature: float | None) -> F64:
        """Where the faces are at a temperature (°C; None: 20 °C), shape (n,), mm."""
        return self.places * CalibratedLength(1.0, expansion=self.expansion).at(temperature)

    def gauge(self, face: int) -> str:
        """What a row of a face is measured against: its length from the first; empty for that."""
        return f"{self.faces[face]} ({self.places[face]:.6f} mm)" if face else ""
