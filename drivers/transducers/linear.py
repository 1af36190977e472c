"""Straight lines: 4–20 mA loops with NAMUR NE 43 limits, and value = scale · raw + offset."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from abbe.drivers.transducers.base import (
    SensorFaultError,
    Transducer,
    TransducerConfig,
    TransducerFault,
    require_number,
)

NO_CURRENT = 1.0
"""Below this (mA) nothing lives in the loop: no transmitter draws so little."""


class CurrentLoopConfig(TransducerConfig):
    """A 4–20 mA transmitter; the raw number is in mA.

    NAMUR NE 43 (2003): 3.8 to 20.5 mA is measurement, up to 3.6 mA and from 21 mA the transmitter
    signals its own failure; between them is saturation, neither.

    Attributes
    ----------
    at_4mA, at_20mA
        Physical values at both ends, in `unit`.
    unit
        Unit of the value.
    scale
        mA per unit of the raw number (0.001 for µA; 1000/250 for volts over 250 Ω).
    alarm_low, measure_low, measure_high, alarm_high
        The recommendation's four currents, mA.
    """

    type: Literal["current-loop"] = "current-loop"
    at_4mA: float  # noqa: N815  (mA is a unit)
    at_20mA: float  # noqa: N815
    unit: str = "degC"
    scale: float = Field(default=1.0, gt=0)
    alarm_low: float = 3.6
    measure_low: float = 3.8
    measure_high: float = 20.5
    alarm_high: float = 21.0

    @model_validator(mode="after")
    def _valid(self) -> Self:
        if self.at_4mA == self.at_20mA:
            raise ValueError(f"at_4mA and at_20mA are both {self.at_4mA:g}: no slope")
        if not NO_CURRENT < self.alarm_low <= self.measure_low <= 4.0:
            raise ValueError(
                f"found alarm_low = {self.alarm_low:g}, measure_low = {self.measure_low:g} mA; "
                f"expected {NO_CURRENT:g} < alarm_low <= measure_low <= 4"
            )
        if not 20.0 <= self.measure_high <= self.alarm_high:
            raise ValueError(
                f"found measure_high = {self.measure_high:g}, alarm_high = {self.alarm_high:g} "
                "mA; expected 20 <= measure_high <= alarm_high"
            )
        return self


class CurrentLoop(Transducer):
    """A 4–20 mA input."""

    raw_unit = "mA"

    def __init__(self, config: CurrentLoopConfig) -> None:
        self._c = config
        self.unit = config.unit

    def value(self, raw: float) -> float:
        """Value in `unit`; see `Transducer.value`."""
        require_number(raw)
        c = self._c
        current = raw * c.scale
        if current < c.measure_low:
            if current < NO_CURRENT:
                raise SensorFaultError(
                    TransducerFault.BROKEN_WIRE, f"{current:.2f} mA, below {NO_CURRENT:g} mA"
                )
            if current <= c.alarm_low:
                raise SensorFaultError(
                    TransducerFault.TRANSMITTER_ALARM,
                    f"{current:.2f} mA, at or below {c.alarm_low:g} mA (NE 43)",
                )
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{current:.2f} mA, below {c.measure_low:g} mA (NE 43)",
            )
        if current > c.measure_high:
            if current >= c.alarm_high:
                raise SensorFaultError(
                    TransducerFault.TRANSMITTER_ALARM,
                    f"{current:.2f} mA, at or above {c.alarm_high:g} mA (NE 43); "
                    "or a short circuit",
                )
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{current:.2f} mA, above {c.measure_high:g} mA (NE 43)",
            )
        return c.at_4mA + (c.at_20mA - c.at_4mA) * (current - 4.0) / 16.0

    def inverse(self, value: float) -> float:
        """Raw number at a value; see `Transducer.inverse`."""
        require_number(value)
        c = self._c
        current = 4.0 + 16.0 * (value - c.at_4mA) / (c.at_20mA - c.at_4mA)
        if not c.measure_low <= current <= c.measure_high:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{value:g} {c.unit} needs {current:.2f} mA, outside {c.measure_low:g} to "
                f"{c.measure_high:g} mA",
            )
        return current / c.scale


class LinearConfig(TransducerConfig):
    """``value = scale · raw + offset``, believed between `min` and `max`.

    Attributes
    ----------
    scale, offset
        In `unit` per raw unit, and `unit`.
    unit
        Unit of the value.
    min, max
        Optional limits of belief, in `unit`.
    """

    type: Literal["linear"] = "linear"
    scale: float = 1.0
    offset: float = 0.0
    unit: str
    min: float | None = None
    max: float | None = None

    @model_validator(mode="after")
    def _valid(self) -> Self:
        if self.scale == 0.0:
            raise ValueError("scale is 0: every raw number would give the same value")
        if self.min is not None and self.max is not None and self.min >= self.max:
            raise ValueError(f"min ({self.min:g}) must lie below max ({self.max:g})")
        return self


class Linear(Transducer):
    """A straight line with limits."""

    raw_unit = "number"

    def __init__(self, config: LinearConfig) -> None:
        self._c = config
        self.unit = config.unit

    def value(self, raw: float) -> float:
        """Value in `unit`; see `Transducer.value`."""
        require_number(raw)
        value = self._c.scale * raw + self._c.offset
        self._check(value)
        return value

    def inverse(self, value: float) -> float:
        """Raw number at a value; see `Transducer.inverse`."""
        require_number(value)
        self._check(value)
        return (value - self._c.offset) / self._c.scale

    def _check(self, value: float) -> None:
        c = self._c
        if c.min is not None and value < c.min:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE, f"{value:g} {c.unit}, below {c.min:g} {c.unit}"
            )
        if c.max is not None and value > c.max:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE, f"{value:g} {c.unit}, above {c.max:g} {c.unit}"
            )
