"""A calibrated length: what a material standard of size is at the temperature that it has."""

from __future__ import annotations

import math
from dataclasses import dataclass

REFERENCE = 20.0
"""Temperature at which lengths are calibrated, °C (ISO 1)."""


@dataclass(frozen=True, slots=True)
class CalibratedLength:
    """A length of a material standard of size, as its certificate states it.

    Attributes
    ----------
    length
        At 20 °C, mm.
    sd
        Standard uncertainty of its calibration (k = 1), mm.
    expansion, expansion_sd
        Coefficient of thermal expansion and its standard uncertainty, 1/K.
    """

    length: float
    sd: float = 0.0
    expansion: float = 0.0
    expansion_sd: float = 0.0

    def at(self, temperature: float | None) -> float:
        """The length at a temperature (°C), mm; None: at 20 °C.

        >>> round(CalibratedLength(515.0, expansion=11.5e-6).at(21.0), 7)
        515.0059225
        """
        warm = 0.0 if temperature is None else temperature - REFERENCE
        return self.length * (1.0 + self.expansion * warm)

    def uncertainty(self, temperature: float | None = None, temperature_sd: float = 0.0) -> float:
        """Standard uncertainty of `at`, mm: calibration, expansion, temperature (ISO/TS 23165).

        Parameters
        ----------
        temperature
            °C; None: 20 °C.
        temperature_sd
            Standard uncertainty of the temperature, K.
        """
        warm = 0.0 if temperature is None else temperature - REFERENCE
        return math.hypot(
            self.sd,
            self.length * warm * self.expansion_sd,
            self.length * self.expansion * temperature_sd,
        )
