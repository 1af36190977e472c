"""Units of MTConnect (Part 2, units of a DataItem) beside those of a configuration."""

from __future__ import annotations

_STATED = {
    "mm": "MILLIMETER", "deg": "DEGREE", "degC": "CELSIUS", "rpm": "REVOLUTION/MINUTE",
    "1/min": "REVOLUTION/MINUTE", "mm/s": "MILLIMETER/SECOND",
    "mm/s2": "MILLIMETER/SECOND^2", "mm/s²": "MILLIMETER/SECOND^2", "deg/s": "DEGREE/SECOND",
    "N": "NEWTON", "Nm": "NEWTON_METER", "kg": "KILOGRAM", "%": "PERCENT", "Pa": "PASCAL",
    "V": "VOLT", "A": "AMPERE", "W": "WATT", "Hz": "HERTZ", "s": "SECOND", "1": "COUNT",
}  # fmt: skip
_OTHERS = {
    "in": "INCH", "ft": "FOOT", "m": "METER", "cm": "CENTIMETER", "µm": "MICRON", "um": "MICRON",
    "degF": "FAHRENHEIT", "K": "KELVIN", "rad": "RADIAN", "µrad": "MICRO_RADIAN",
    "urad": "MICRO_RADIAN", "mm/min": "MILLIMETER/MINUTE", "bar": "BAR",
}  # fmt: skip
"""Not the standard's own, yet stated by agents that do not convert (Part 2, native units)."""
_NAMES = _STATED | _OTHERS
_OF_THREE = "_3D"


def contradicts(unit: str, stated: str) -> bool:
    """Whether a unit that is configured is another one than an agent states.

    >>> contradicts("mm", "MILLIMETER"), contradicts("mm", "MILLIMETER_3D")
    (False, False)
    >>> contradicts("in", "MILLIMETER"), contradicts("mm", "INCH"), contradicts("mm", "DEGREE")
    (True, True, True)
    """
    one = stated.removesuffix(_OF_THREE)
    return one not in (unit, _NAMES.get(unit))
