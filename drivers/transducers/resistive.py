"""The base of resistance thermometers: circuit, lead wires, named faults, offset."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Self

from pydantic import Field, model_validator

from abbe.compcore.units import in_digits
from abbe.drivers.transducers.base import (
    SensorFaultError,
    Transducer,
    TransducerConfig,
    TransducerFault,
    require_number,
)
from abbe.drivers.transducers.circuit import Circuit, OhmCircuit

ZERO_CELSIUS = 273.15
"""0 °C in K."""


class ResistiveConfig(TransducerConfig):
    """Keys common to thermistors, R–T tables and platinum sensors.

    Attributes
    ----------
    circuit
        How the resistance is measured; default: the input gives ohms.
    lead_resistance
        Sum of both lead wires, Ω; subtracted. 0 for three- and four-wire inputs.
    parallel
        A resistor across the sensor (linearised inputs), Ω.
    open_above
        A sensor resistance (Ω) above this is a broken wire.
    short_below
        A sensor resistance (Ω) below this is a short circuit.
    min_temperature, max_temperature
        Range in which the sensor is believed, °C.
    temperature_offset
        Added to the temperature, K: the sensor's known deviation with reversed sign.
    """

    circuit: Circuit = OhmCircuit()
    lead_resistance: float = Field(default=0.0, ge=0)
    parallel: float | None = Field(default=None, gt=0)
    open_above: float = Field(default=1e6, gt=0)
    short_below: float = Field(default=10.0, ge=0)
    min_temperature: float = Field(default=-50.0, gt=-ZERO_CELSIUS)
    max_temperature: float = 150.0
    temperature_offset: float = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.short_below >= self.open_above:
            raise ValueError(
                f"short_below ({self.short_below:g} Ω) must lie below "
                f"open_above ({self.open_above:g} Ω)"
            )
        if self.min_temperature >= self.max_temperature:
            raise ValueError(
                f"min_temperature ({self.min_temperature:g} °C) must lie below "
                f"max_temperature ({self.max_temperature:g} °C)"
            )
        return self


class ResistiveTransducer(Transducer):
    """A sensor whose resistance is a monotone function of its temperature.

    Subclasses give the function and its inverse; this class takes away the circuit, the
    lead wires and a parallel resistor, and names broken wires, short circuits and values out
    of range before any formula is asked.
    """

    unit = "degC"

    def __init__(self, config: ResistiveConfig) -> None:
        self._c = config
        self.raw_unit = config.circuit.raw_unit

    @abstractmethod
    def temperature(self, ohms: float) -> float:
        """Temperature (°C) of the bare sensor at a resistance (Ω) inside its limits."""

    @abstractmethod
    def resistance(self, temperature: float) -> float:
        """Resistance (Ω) of the bare sensor at a temperature (°C)."""

    def value(self, raw: float) -> float:
        """Temperature in °C; see `Transducer.value`."""
        require_number(raw)
        c = self._c
        terminals = c.circuit.ohms(raw)
        ohms = terminals - c.lead_resistance
        if c.parallel is not None:
            ohms = math.inf if ohms >= c.parallel else ohms * c.parallel / (c.parallel - ohms)
        if ohms > c.open_above:
            raise SensorFaultError(
                TransducerFault.BROKEN_WIRE,
                f"{format_ohms(ohms)}, above {format_ohms(c.open_above)}",
            )
        if ohms < c.short_below:
            raise SensorFaultError(
                TransducerFault.SHORT_CIRCUIT,
                f"{format_ohms(ohms)}, below {format_ohms(c.short_below)}",
            )
        t = self.temperature(ohms) + c.temperature_offset
        # The value itself stays out of the message: it is not a temperature.
        if t < c.min_temperature:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{format_ohms(ohms)} would be colder than {c.min_temperature:g} °C",
            )
        if t > c.max_temperature:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{format_ohms(ohms)} would be hotter than {c.max_temperature:g} °C",
            )
        return t

    def inverse(self, value: float) -> float:
        """Raw number at a temperature (°C); see `Transducer.inverse`."""
        require_number(value)
        c = self._c
        if not c.min_temperature <= value <= c.max_temperature:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{value:g} °C, outside {c.min_temperature:g} to {c.max_temperature:g} °C",
            )
        ohms = self.resistance(value - c.temperature_offset)
        if c.parallel is not None:
            ohms = ohms * c.parallel / (ohms + c.parallel)
        return c.circuit.raw(ohms + c.lead_resistance)

    def check_limits(self) -> None:
        """Refuse a configuration whose resistance limits cut its temperature range off.

        Raises
        ------
        ValueError
            When a temperature inside the range would already be reported as a broken wire or
            a short circuit.
        """
        c = self._c
        ends = (self.temperature(c.short_below), self.temperature(c.open_above))
        low, high = (t + c.temperature_offset for t in sorted(ends))
        if not (low <= c.min_temperature and c.max_temperature <= high):
            raise ValueError(
                f"between short_below = {c.short_below:g} Ω and open_above = {c.open_above:g} Ω "
                f"this sensor covers {low:.1f} to {high:.1f} °C, less than min_temperature = "
                f"{c.min_temperature:g} to max_temperature = {c.max_temperature:g} °C: "
                "narrow the temperatures or widen the limits"
            )


def format_ohms(ohms: float) -> str:
    """Resistance for people: ``4.2 MΩ``, ``10.35 kΩ``, ``3.1 Ω``, ``infinite``."""
    if math.isinf(ohms):
        return "infinite resistance"
    for scale, unit in ((1e6, "MΩ"), (1e3, "kΩ")):
        if abs(ohms) >= scale:
            return f"{in_digits(ohms / scale, 4)} {unit}"
    return f"{in_digits(ohms, 4)} Ω"
