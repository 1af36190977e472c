"""Measuring circuits of resistances: from an input's raw number to the sensor's own ohms."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from abbe.drivers.transducers.base import SensorFaultError, TransducerConfig, TransducerFault


class OhmCircuit(TransducerConfig):
    """The input already gives a resistance: ohms = raw × scale (kΩ: 1000)."""

    kind: Literal["ohm"] = "ohm"
    scale: float = Field(default=1.0, gt=0)

    @property
    def raw_unit(self) -> str:
        """The unit of the raw number."""
        return "ohm"

    def ohms(self, raw: float) -> float:
        """Resistance at the input's terminals, Ω."""
        return raw * self.scale

    def raw(self, ohms: float) -> float:
        """Raw number that stands for a resistance (Ω) at the terminals."""
        return ohms / self.scale


class CurrentCircuit(TransducerConfig):
    """A constant current drives the sensor and the voltage is read: R = U / I.

    Attributes
    ----------
    current
        Excitation, A.
    scale
        Volts per unit of the raw number.
    """

    kind: Literal["current"] = "current"
    current: float = Field(gt=0)
    scale: float = Field(default=1.0, gt=0)

    @property
    def raw_unit(self) -> str:
        """The unit of the raw number."""
        return "V"

    def ohms(self, raw: float) -> float:
        """Resistance at the input's terminals, Ω."""
        return raw * self.scale / self.current

    def raw(self, ohms: float) -> float:
        """Raw number that stands for a resistance (Ω) at the terminals."""
        return ohms * self.current / self.scale


class DividerCircuit(TransducerConfig):
    """A voltage divider, or one half of a Wheatstone bridge, read as a ratio.

    With ρ the ratio of the sensor's node to the supply: sensor at the low side (to ground)
    ``R = R_s ρ / (1 − ρ)``, at the high side ``R = R_s (1 − ρ) / ρ``. In a bridge the input reads
    the difference of the two half bridges, and ρ = raw / full_scale + `bridge_ratio`.

    Attributes
    ----------
    series
        The fixed resistor in series, Ω.
    full_scale
        Raw number at the full supply (1 for a ratio, 4095 for a 12-bit converter on the same
        reference, the supply for volts).
    sensor
        Which side of the divider the sensor is.
    bridge_ratio
        Ratio of the other half bridge: 0 for a plain divider, 0.5 for two equal arms.
    """

    kind: Literal["divider"] = "divider"
    series: float = Field(gt=0)
    full_scale: float = Field(default=1.0, gt=0)
    sensor: Literal["low", "high"] = "low"
    bridge_ratio: float = Field(default=0.0, ge=0, lt=1)

    @property
    def raw_unit(self) -> str:
        """The unit of the raw number."""
        return "ratio" if self.full_scale == 1.0 else "count"

    def ohms(self, raw: float) -> float:
        """Resistance at the input's terminals, Ω; infinite when the sensor is open.

        Raises
        ------
        SensorFaultError
            More than 2 % outside the supply: then it is the input that is wrong.
        """
        ratio = raw / self.full_scale + self.bridge_ratio
        if not -0.02 <= ratio <= 1.02:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE, f"raw {raw:g} is {ratio:.2f} of the divider's supply"
            )
        share = min(max(ratio if self.sensor == "low" else 1.0 - ratio, 0.0), 1.0)
        return math.inf if share >= 1.0 else self.series * share / (1.0 - share)

    def raw(self, ohms: float) -> float:
        """Raw number that stands for a resistance (Ω) at the terminals."""
        share = 1.0 if math.isinf(ohms) else ohms / (ohms + self.series)
        ratio = share if self.sensor == "low" else 1.0 - share
        return (ratio - self.bridge_ratio) * self.full_scale


Circuit = Annotated[OhmCircuit | CurrentCircuit | DividerCircuit, Field(discriminator="kind")]
