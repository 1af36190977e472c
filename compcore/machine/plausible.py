"""Plausible values of measured quantities: ranges by kind and unit, greatest rates of change.

Far wider than what is normal, and far narrower than what a number can hold: a value outside comes
from a wrong unit, a slipped decimal point, a broken sensor or a damaged file, and nothing that was
computed from it could be believed. Files are checked against these ranges when they are read, live
readings before they are used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.machine import Axis, Signal
from abbe.compcore.sentences import said

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Range:
    """The range of plausible values of a quantity, in its unit, and its greatest rate of change.

    Attributes
    ----------
    low, high
        Least and greatest believable value, in `unit`.
    unit
        Its unit, as files spell it.
    rate
        Fastest believable change in `unit` per second; infinite where the quantity may jump.
    """

    low: float
    high: float
    unit: str
    rate: float = math.inf

    def outside(self, values: F64) -> NDArray[np.bool_]:
        """Which values are not believable, shape (n,); NaN (a blank) is not judged here."""
        return (values < self.low) | (values > self.high)

    def holds(self, value: float) -> bool:
        """Whether a single value is believable; NaN and infinity are not."""
        return self.low <= value <= self.high

    def __str__(self) -> str:
        high = f"{self.high:g} {self.unit}" if self.unit else f"{self.high:g}"
        return said("{low} to {high}", low=f"{self.low:g}", high=high)


_C = "degC"
_TEMPERATURES: Mapping[str, Range] = {
    "ambient": Range(-30.0, 60.0, _C, 1.0),
    "air": Range(-30.0, 60.0, _C, 1.0),
    "scale": Range(-30.0, 100.0, _C, 0.5),
    "structure": Range(-30.0, 100.0, _C, 0.5),
    "workpiece": Range(-50.0, 200.0, _C, 5.0),
    "screw": Range(-30.0, 120.0, _C, 1.0),
    "coolant": Range(-30.0, 120.0, _C, 5.0),
    "spindle": Range(-30.0, 200.0, _C, 2.0),
    "other": Range(-60.0, 200.0, _C, 5.0),
}
"""Role → °C. A thermometer that is unplugged or broken shows −273, 850 or the like; one in K that
is taken for °C shows 293."""

_BY_UNIT: Mapping[str, Range] = {
    "degC": _TEMPERATURES["other"],
    "K": Range(-200.0, 480.0, "K", 5.0),  # a difference, or counted from absolute zero
    "rpm": Range(-3e5, 3e5, "rpm", 1e5),
    "mm/min": Range(-6e5, 6e5, "mm/min"),
    "mm/s": Range(-1e4, 1e4, "mm/s"),
    "m/min": Range(-600.0, 600.0, "m/min"),
    "hPa": Range(400.0, 1200.0, "hPa", 20.0),
    "mbar": Range(400.0, 1200.0, "mbar", 20.0),
    "kPa": Range(-100.0, 1e5, "kPa"),
    "Pa": Range(-1e5, 1e8, "Pa"),
    "bar": Range(-1.0, 1e4, "bar"),
    "kg": Range(-1e3, 1e6, "kg"),
    "g": Range(-1e6, 1e9, "g"),
    "t": Range(-1.0, 1e3, "t"),
    "N": Range(-1e7, 1e7, "N"),
    "kN": Range(-1e4, 1e4, "kN"),
    "Nm": Range(-1e6, 1e6, "Nm"),
    "%": Range(-400.0, 400.0, "%"),  # of a drive's load, which has a sign and may exceed 100
    "A": Range(-1e4, 1e4, "A"),
    "V": Range(-1e5, 1e5, "V"),
    "W": Range(-1e7, 1e7, "W"),
    "kW": Range(-1e4, 1e4, "kW"),
    "Hz": Range(-1e6, 1e6, "Hz"),
    "ppm": Range(-1e6, 1e6, "ppm"),
    "mm": Range(-1e5, 1e5, "mm", 1e4),
    "um": Range(-1e8, 1e8, "um", 1e7),
    "deg": Range(-1e6, 1e6, "deg"),
    "rad": Range(-2e4, 2e4, "rad"),
    "s": Range(-1e10, 1e10, "s"),
}
"""Unit → what a signal in it can be, where its role says no more."""

_BY_ROLE_AND_UNIT: Mapping[tuple[str, str], Range] = {
    ("air", "%"): Range(0.0, 105.0, "%", 20.0),
    ("ambient", "%"): Range(0.0, 105.0, "%", 20.0),
}
"""Humidity; sensors that are wet or out of calibration show a little more than 100 %."""

_SPELLINGS = {"°C": "degC", "C": "degC", "1/min": "rpm", "min-1": "rpm", "µm": "um", "°": "deg"}
_ANYTHING = Range(-1e15, 1e15, "")
"""Of a column of which nothing is known: squares and sums of it are still numbers."""

TIME = Range(-1e10, 1e10, "s")
"""Seconds since a campaign's start, or since 1970."""
TOOL = Range(-5000.0, 5000.0, "mm", 1e4)
"""A component of a tool's or probe's offset."""
POINT = Range(-2e5, 2e5, "mm")
"""A coordinate of a base point, a rotation point, an axis's location: a tracker reaches 160 m."""
DISTANCE = Range(1e-6, 4e5, "mm")
"""A measured distance."""
DISPLACEMENT = Range(-1e5, 1e5, "um")
"""A measured error of position: 0.1 m, a tenfold unit error of the worst machine."""
ROTATION = Range(-1e5, 1e5, "urad")
"""A measured error of orientation: 6°, beyond which angles no longer add."""
TURNED = Range(-3.2e6, 3.2e6, "urad")
"""The same where rotary axes turn: half a turn, since an encoder may count from anywhere."""
SD_DISPLACEMENT = Range(1e-6, 1e5, "um")
SD_ROTATION = Range(1e-6, 1e5, "urad")
SD_DISTANCE = Range(1e-9, 1e2, "mm")
"""Standard uncertainties: from a thousandth of what the best interferometer resolves."""
SD_RATIO = 1e7
"""How far the uncertainties of one campaign's rows may be apart: more than this, and the others
take no part in the fit at all."""
SPINDLE_ANGLE = Range(-1e7, 1e7, "degrees")
REFERENCE_TEMPERATURE = Range(-20.0, 60.0, _C)
"""To which a machine's lengths are referred; 20 °C by ISO 1."""
TRAVEL = Range(-1e5, 1e5, "mm")
TRAVEL_ROTARY = Range(-36e3, 36e3, "degrees")
"""Ends of an axis's travel."""
SHORTEST_TRAVEL = 1e-3
"""mm or degrees."""

_SPEED = 1e4
"""mm/s: twice the fastest linear motors."""
_SPEED_ROTARY = math.degrees(500.0)
"""degrees/s: a spindle that positions."""
_MARGIN = 0.5
"""Part of its travel by which an axis may be recorded beyond each end …"""
_LEAST_MARGIN = 50.0
"""… and at least this, mm …"""
_LEAST_MARGIN_ROTARY = 36e3
"""… or degrees, a hundred turns: an axis that turns for ever is counted on."""


def signal_range(signal: Signal | None) -> Range:
    """The plausible range of a signal by its role and unit; None: not in the model.

    >>> from abbe.compcore.machine.machine import Signal
    >>> str(signal_range(Signal("T_x", "degC", "scale")))
    '-30 to 100 degC'
    >>> signal_range(Signal("p", "hPa", "air")).holds(1013.0)
    True
    """
    if signal is None:
        return _ANYTHING
    unit = usual_unit(signal)
    if (signal.role, unit) in _BY_ROLE_AND_UNIT:
        return _BY_ROLE_AND_UNIT[signal.role, unit]
    if unit == _C:
        return _TEMPERATURES.get(signal.role, _TEMPERATURES["other"])
    return _BY_UNIT.get(unit, replace(_ANYTHING, unit=signal.unit))


def usual_unit(signal: Signal) -> str:
    """The signal's unit as it is mostly spelled."""
    return _SPELLINGS.get(signal.unit, signal.unit)


def position_range(axis: Axis) -> Range:
    """The plausible range of an axis's recorded positions, mm (rotary: degrees).

    A travel in a model file is what was mapped; set-ups reach beyond it, and controllers differ in
    where they count from. At least 50 mm, or a hundred turns, are allowed.
    """
    scale = math.degrees(1.0) if axis.rotary else 1.0
    low, high = (end * scale for end in axis.travel)
    least = _LEAST_MARGIN_ROTARY if axis.rotary else _LEAST_MARGIN
    margin = max(_MARGIN * (high - low), least)
    unit = "degrees" if axis.rotary else "mm"
    speed = _SPEED_ROTARY if axis.rotary else _SPEED
    return Range(low - margin, high + margin, unit, speed)


_FAHRENHEIT = (53.6, 95.0)
"""What 12 to 35 °C read in °F: no shop, scale or casting is that warm in °C."""
BODIES = ("scale", "structure", "workpiece", "ambient", "air", "other")
"""Roles of thermometers that show about the shop's temperature."""


def like_fahrenheit(value: float) -> bool:
    """Whether a temperature of a shop, scale or casting is plausible in °F only."""
    return _FAHRENHEIT[0] <= value <= _FAHRENHEIT[1]


def perhaps_fahrenheit(
    name: str, value: float, role: str, stated: str = "the model"
) -> Iterator[str]:
    """Whether a temperature (°C) is plausible only when read as °F.

    `role` as in the model file; `stated`: who says that it is in °C.
    """
    if role in BODIES and like_fahrenheit(value):
        yield (
            f"{name} reads {value:.4g} °C; {value:.4g} °F would be {(value - 32.0) / 1.8:.3g} °C: "
            f"is it in the unit that {stated} states?"
        )
