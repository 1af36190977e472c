"""NTC thermistors by formula: Steinhart–Hart, four terms in ln(R/R25), and beta.

All three are one polynomial, ``1/T = c0 + c1 L + c2 L² + c3 L³`` with ``L = ln(R / R_ref)`` and T
in K, and differ only in what their makers print.

Sources: J. S. Steinhart and S. R. Hart, Deep-Sea Research 15 (1968) 497 (three terms, R_ref = 1 Ω);
Vishay's NTC data sheets (four terms, R_ref = R25); the beta equation is the two-term form.
"""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import Field, model_validator

from abbe.drivers.transducers.resistive import ZERO_CELSIUS, ResistiveConfig, ResistiveTransducer

R25_TOLERANCE = 0.1
"""How far (K) a formula may be from 25 °C at `r25`: wrong constants are usually further off."""


class SteinhartHartConfig(ResistiveConfig):
    """``1/T = a + b ln R + c (ln R)³``, T in K, R in Ω.

    Attributes
    ----------
    a, b, c
        The maker's constants, 1/K. YSI 44006/44031 (10 kΩ): 1.032e-3, 2.387e-4, 1.580e-7.
    r25
        Resistance at 25 °C, Ω. Optional; when given, the constants must agree with it within
        0.1 K. The set 1.009249522e-3, 2.378405444e-4, 2.019202697e-7 that is copied from
        page to page gives 24.68 °C at 10 kΩ, and is refused with ``r25 = 10000``.
    """

    type: Literal["steinhart-hart"] = "steinhart-hart"
    a: float
    b: float
    c: float
    r25: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _valid(self) -> Self:
        Thermistor(self).check(self.r25)
        return self


class NtcRatioConfig(ResistiveConfig):
    """``1/T = a + b L + c L² + d L³`` with ``L = ln(R / r25)``, T in K.

    Attributes
    ----------
    r25
        Resistance at 25 °C, Ω.
    a, b, c, d
        The maker's constants, 1/K; for NTCLE100E3103 3.3539438e-3, 2.5646095e-4,
        2.5158166e-6, 1.0503069e-7.
    """

    type: Literal["ntc-ratio"] = "ntc-ratio"
    r25: float = Field(gt=0)
    a: float
    b: float
    c: float
    d: float

    @model_validator(mode="after")
    def _valid(self) -> Self:
        Thermistor(self).check(self.r25)
        return self


class BetaConfig(ResistiveConfig):
    """``1/T = 1/T_ref + ln(R / r_ref) / beta``, T in K.

    The coarsest form: right at one temperature, and a beta from another pair of temperatures
    costs degrees (4160 Ω of a 10 kΩ sensor: 49.6 °C with 3435 K, 46.1 °C with 3950 K).

    Attributes
    ----------
    r25
        Resistance at `reference`, Ω.
    beta
        K.
    reference
        Temperature at which the sensor has `r25`, °C.
    """

    type: Literal["beta"] = "beta"
    r25: float = Field(gt=0)
    beta: float = Field(gt=0)
    reference: float = 25.0

    @model_validator(mode="after")
    def _valid(self) -> Self:
        Thermistor(self).check(None)
        return self


ThermistorConfig = SteinhartHartConfig | NtcRatioConfig | BetaConfig


class Thermistor(ResistiveTransducer):
    """An NTC thermistor described by a polynomial in ln(R / R_ref)."""

    def __init__(self, config: ThermistorConfig) -> None:
        super().__init__(config)
        if isinstance(config, SteinhartHartConfig):
            self._r_ref = 1.0
            self._poly = (config.a, config.b, 0.0, config.c)
        elif isinstance(config, NtcRatioConfig):
            self._r_ref = config.r25
            self._poly = (config.a, config.b, config.c, config.d)
        else:
            self._r_ref = config.r25
            kelvin = config.reference + ZERO_CELSIUS
            self._poly = (1.0 / kelvin, 1.0 / config.beta, 0.0, 0.0)

    def temperature(self, ohms: float) -> float:
        """Temperature (°C) at a resistance (Ω); see the module for the formula."""
        c0, c1, c2, c3 = self._poly
        x = math.log(ohms / self._r_ref)
        return 1.0 / (c0 + x * (c1 + x * (c2 + x * c3))) - ZERO_CELSIUS

    def resistance(self, temperature: float) -> float:
        """Resistance (Ω) at a temperature (°C) between the sensor's limits.

        By bisection of ln R to the last bit: the polynomial is monotone there, which was
        checked, and this direction is not on the live path.
        """
        low, high = math.log(self._c.short_below), math.log(self._c.open_above)
        while low < (middle := 0.5 * (low + high)) < high:
            if self.temperature(math.exp(middle)) > temperature:
                low = middle
            else:
                high = middle
        return math.exp(0.5 * (low + high))

    def check(self, r25: float | None) -> None:
        """Refuse constants that are no NTC thermistor, or not the one with this `r25`.

        Raises
        ------
        ValueError
            Not falling monotonely between the limits, not positive, or off at 25 °C.
        """
        if self._c.short_below <= 0.0:
            raise ValueError("short_below must be above 0 Ω for a thermistor")
        c0, c1, c2, c3 = self._poly
        ends = [math.log(r / self._r_ref) for r in (self._c.short_below, self._c.open_above)]
        # A quadratic's least value on an interval is at an end or at its vertex.
        places = [*ends]
        if c3 != 0.0 and ends[0] < -c2 / (3.0 * c3) < ends[1]:
            places.append(-c2 / (3.0 * c3))
        if min(c1 + x * (2.0 * c2 + 3.0 * c3 * x) for x in places) <= 0.0:
            raise ValueError(
                f"these constants do not fall monotonely from {self._c.short_below:g} to "
                f"{self._c.open_above:g} Ω: not an NTC thermistor's, or not for Ω and K"
            )
        if c0 + ends[0] * (c1 + ends[0] * (c2 + ends[0] * c3)) <= 0.0:
            raise ValueError(
                f"these constants give no temperature at {self._c.short_below:g} Ω (1/T is not "
                "positive): not for Ω and K?"
            )
        if r25 is not None and abs(self.temperature(r25) - 25.0) > R25_TOLERANCE:
            raise ValueError(
                f"these constants give {self.temperature(r25):.2f} °C at r25 = {r25:g} Ω instead "
                "of 25 °C: constants of another sensor"
            )
        self.check_limits()
