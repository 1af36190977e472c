"""Resistance sensors by their maker's R–T table."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from abbe.drivers.transducers.base import SensorFaultError, TransducerFault
from abbe.drivers.transducers.resistive import (
    ZERO_CELSIUS,
    ResistiveConfig,
    ResistiveTransducer,
    format_ohms,
)


class RTTableConfig(ResistiveConfig):
    """Rows of (°C, Ω), monotone in both; linear between rows in 1/T against ln R.

    An NTC thermistor is nearly straight on these axes: with rows every 5 K the interpolation
    costs less than 6 mK (every 10 K: 22 mK) against Steinhart–Hart. Nothing is extrapolated:
    outside the table is out of range. The table's ends are the default temperature range.

    Attributes
    ----------
    table
        At least two rows ``[temperature in °C, resistance in Ω]``, temperatures rising;
        resistances all falling (NTC) or all rising (PTC, platinum).
    """

    type: Literal["rt-table"] = "rt-table"
    table: tuple[Annotated[tuple[float, float], Field(strict=False)], ...] = Field(
        min_length=2, strict=False
    )
    min_temperature: float = -ZERO_CELSIUS
    max_temperature: float = math.inf

    @model_validator(mode="before")
    @classmethod
    def _default_range(cls, data: object) -> object:
        if isinstance(data, dict) and isinstance(data.get("table"), list | tuple):
            try:
                temperatures = [float(row[0]) for row in data["table"]]
            except (TypeError, ValueError, IndexError, KeyError):
                return data  # the field's own check says what is wrong with the row
            offset = data.get("temperature_offset", 0.0)
            if temperatures and isinstance(offset, int | float):
                ends = {
                    "min_temperature": min(temperatures) + offset,
                    "max_temperature": max(temperatures) + offset,
                }
                return ends | data
        return data

    @model_validator(mode="after")
    def _valid(self) -> Self:
        previous: tuple[float, float] | None = None
        falling = self.table[1][1] < self.table[0][1]
        for number, (t, r) in enumerate(self.table, start=1):
            if t <= -ZERO_CELSIUS or r <= 0:
                raise ValueError(f"table row {number}: {t:g} °C, {r:g} Ω cannot be")
            if previous is not None:
                if t <= previous[0]:
                    raise ValueError(
                        f"table row {number}: temperatures must rise, found {t:g} °C after "
                        f"{previous[0]:g} °C"
                    )
                if r == previous[1] or (r < previous[1]) is not falling:
                    raise ValueError(
                        f"table row {number}: resistances must keep "
                        f"{'falling' if falling else 'rising'}, found {r:g} Ω after "
                        f"{previous[1]:g} Ω"
                    )
            previous = (t, r)
        resistances = [r for _, r in self.table]
        if not self.short_below <= min(resistances) or not max(resistances) <= self.open_above:
            raise ValueError(
                f"the table reaches from {format_ohms(min(resistances))} to "
                f"{format_ohms(max(resistances))}, beyond short_below = {self.short_below:g} Ω or "
                f"open_above = {self.open_above:g} Ω, which name faults"
            )
        return self


class RTTable(ResistiveTransducer):
    """A sensor given by its table."""

    def __init__(self, config: RTTableConfig) -> None:
        super().__init__(config)
        rows = sorted(config.table, key=lambda row: row[1])
        self._x = [math.log(r) for _, r in rows]
        self._y = [1.0 / (t + ZERO_CELSIUS) for t, _ in rows]
        self._low, self._high = rows[0][1], rows[-1][1]

    def temperature(self, ohms: float) -> float:
        """Temperature (°C) at a resistance (Ω); out of range beyond the table's ends."""
        if not self._low <= ohms <= self._high:
            raise SensorFaultError(
                TransducerFault.OUT_OF_RANGE,
                f"{format_ohms(ohms)}, outside the table's {format_ohms(self._low)} to "
                f"{format_ohms(self._high)}",
            )
        return 1.0 / _interpolate(self._x, self._y, math.log(ohms)) - ZERO_CELSIUS

    def resistance(self, temperature: float) -> float:
        """Resistance (Ω) at a temperature (°C) inside the table."""
        inverse = 1.0 / (temperature + ZERO_CELSIUS)
        if self._y[0] < self._y[-1]:
            return math.exp(_interpolate(self._y, self._x, inverse))
        return math.exp(_interpolate(self._y[::-1], self._x[::-1], inverse))


def _interpolate(x: list[float], y: list[float], at: float) -> float:
    """Linear interpolation in rising x, the end segments' lines beyond the ends."""
    i = min(max(bisect_right(x, at), 1), len(x) - 1)
    return y[i - 1] + (y[i] - y[i - 1]) * (at - x[i - 1]) / (x[i] - x[i - 1])
