"""Platinum resistance thermometers (Pt100, Pt1000) by the Callendar–Van Dusen equation.

``R(t) = R0 (1 + A t + B t²)`` from 0 °C up, ``R(t) = R0 (1 + A t + B t² + C (t − 100) t³)``
below, t in °C (IEC 60751:2022, 4.2). Above 0 °C it is solved as a quadratic; below, where there
is no useful closed form, by Newton's method on the equation itself: no fitted approximation.
"""

from __future__ import annotations

import math
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from abbe.drivers.transducers.base import SensorFaultError, TransducerFault
from abbe.drivers.transducers.resistive import ResistiveConfig, ResistiveTransducer, format_ohms


class PtConfig(ResistiveConfig):
    """A platinum sensor.

    Attributes
    ----------
    r0
        Resistance at 0 °C, Ω: 100 (Pt100), 500, 1000 (Pt1000), or a calibrated value.
    a, b, c
        IEC 60751's constants, or a calibration's; 1/K, 1/K², 1/K⁴.
    open_above, short_below
        Default 5 r0 and 0.1 r0: beyond 850 °C and below −220 °C.
    min_temperature, max_temperature
        Default −200 to 850 °C, the standard's range.
    """

    type: Literal["pt"] = "pt"
    r0: float = Field(default=100.0, gt=0)
    a: float = 3.9083e-3
    b: float = -5.775e-7
    c: float = -4.183e-12
    min_temperature: float = Field(default=-200.0, ge=-200.0)
    max_temperature: float = Field(default=850.0, le=850.0)

    @model_validator(mode="before")
    @classmethod
    def _default_limits(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(r0 := data.get("r0", 100.0), int | float):
            return {"open_above": 5.0 * r0, "short_below": 0.1 * r0} | data
        return data

    @model_validator(mode="after")
    def _valid(self) -> Self:
        if self.a <= 0 or self.a + 2 * self.b * self.max_temperature <= 0:
            raise ValueError("these constants do not rise over the range: not a platinum sensor's")
        Platinum(self).check_limits()
        return self


class Platinum(ResistiveTransducer):
    """A platinum resistance thermometer."""

    def __init__(self, config: PtConfig) -> None:
        super().__init__(config)
        self._r0, self._a, self._b, self._q = config.r0, config.a, config.b, config.c

    def temperature(self, ohms: float) -> float:
        """Temperature (°C) at a resistance (Ω)."""
        a, b = self._a, self._b
        ratio = ohms / self._r0
        discriminant = a * a - 4.0 * b * (1.0 - ratio)
        if discriminant < 0.0:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE, f"{format_ohms(ohms)}, above any platinum sensor's"
            )
        # This form of the root does not cancel near 0 °C, and holds for b = 0.
        t = 2.0 * (ratio - 1.0) / (a + math.sqrt(discriminant))
        if ratio >= 1.0:
            return t
        for _ in range(20):
            residual = self._ratio(t) - ratio
            step = residual / (a + t * (2.0 * b + self._q * t * (4.0 * t - 300.0)))
            t -= step
            if abs(step) < 1e-12 * max(1.0, abs(t)):
                break
        return t

    def resistance(self, temperature: float) -> float:
        """Resistance (Ω) at a temperature (°C)."""
        return self._r0 * self._ratio(temperature)

    def _ratio(self, t: float) -> float:
        ratio = 1.0 + t * (self._a + t * self._b)
        return ratio if t >= 0.0 else ratio + self._q * (t - 100.0) * t**3
