"""Units at the edges: what a file may say, and its factor to the units inside the code.

Inside: mm, rad, °C (differences in K), s. A unit that is not in the table is an error, never a
factor of one.
"""

from __future__ import annotations

import math
from typing import Protocol

from abbe.compcore.errors import InputError

_DEG = math.pi / 180.0

FACTORS: dict[str, tuple[str, float]] = {
    # spelling: (unit inside the code, factor)
    "1": ("1", 1.0),
    "mm": ("mm", 1.0),
    "um": ("mm", 1e-3),
    "µm": ("mm", 1e-3),
    "nm": ("mm", 1e-6),
    "m": ("mm", 1e3),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "urad": ("rad", 1e-6),
    "µrad": ("rad", 1e-6),
    "mm/m": ("rad", 1e-3),
    "um/m": ("rad", 1e-6),
    "deg": ("rad", _DEG),
    "arcsec": ("rad", _DEG / 3600.0),
    "mm/mm": ("1", 1.0),
    "ppm": ("1", 1e-6),
    "1/K": ("1/K", 1.0),
    "ppm/K": ("1/K", 1e-6),
    "s": ("s", 1.0),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
}
"""Spelling → (unit inside the code, factor that the number is multiplied by)."""


def to_internal(value: float, unit: str, expected: str) -> float:
    """A number with its unit as written in a file → the number in `expected`.

    Compound units that the table does not list (``rad/K``, ``mm/kg``) pass when both are spelled
    alike; a leading length or angle, and a time below, may differ in size (``um/K`` for ``mm/K``,
    ``um/h`` for ``mm/s``).

    Raises
    ------
    InputError
        When the unit is unknown or of another kind.
    """
    if unit == expected:
        return value
    base, _, per = unit.partition("/")
    want, _, want_per = expected.partition("/")
    if unit in FACTORS and FACTORS[unit][0] == expected:
        return value * FACTORS[unit][1]
    if base in FACTORS and FACTORS[base][0] == want:
        if per == want_per:
            return value * FACTORS[base][1]
        if want_per == "s" and per in FACTORS and FACTORS[per][0] == "s":
            return value * FACTORS[base][1] / FACTORS[per][1]
    raise InputError("wrong unit", field="unit", found=unit, expected=f"{expected!r} or a multiple")


class Quantity(Protocol):
    """A number with a unit inside the code, as a parameter has one."""

    @property
    def unit(self) -> str:
        """Its unit."""

    @property
    def extent(self) -> bool:
        """Whether it is a place, a period, a lever or a path, and no error."""


def read_in(quantity: Quantity) -> tuple[str, float]:
    """The unit in which people read a quantity, and the factor from the unit inside the code.

    Errors are read in µm, as `display` has it; where a defect lies, how long a period or a dead
    path is, in mm, of a rotary axis in degrees.
    """
    if quantity.extent and quantity.unit == "mm":
        return "mm", 1.0
    if quantity.extent and quantity.unit == "rad":
        return "°", 1.0 / _DEG
    return display(quantity.unit)


def display(unit: str) -> tuple[str, float]:
    """The unit in which people read an error, and the factor from the unit inside the code.

    >>> display("mm")
    ('µm', 1000.0)
    >>> display("rad/K")
    ('µrad/K', 1000000.0)
    """
    if unit == "1":
        return "ppm", 1e6
    if unit == "1/K":
        return "ppm/K", 1e6
    base, slash, per = unit.partition("/")
    slow = 1.0
    if per == "s":
        per, slow = "h", 3600.0  # machines drift by the hour
    if base == "mm":
        return "µm" + slash + per, 1e3 * slow
    if base == "rad":
        return "µrad" + slash + per, 1e6 * slow
    return unit, 1.0


_ROUNDING = 1e-9
"""Part of a value below which its uncertainty is rounding."""


def with_uncertainty(value: float, sd: float | None) -> str:
    """A value and its standard uncertainty, rounded to two digits of the uncertainty.

    As the GUM (JCGM 100, 7.2.6) has it: no digit of the value that means nothing.

    >>> with_uncertainty(114.5032, 0.6123)
    '114.50 ± 0.61'
    >>> with_uncertainty(4.1e-17, 216.0)
    '0 ± 220'
    >>> with_uncertainty(-3.2e-5, None)
    '-0.000032'
    >>> with_uncertainty(4.1234e-9, 2.5e-10)
    '(4.12 ± 0.25)·10⁻⁹'
    >>> with_uncertainty(20.431461538, 1.9e-14)
    '20.43'
    """
    if sd is None or not 0.0 < sd < math.inf or not math.isfinite(value):
        return in_digits(value, 4)
    if sd < _ROUNDING * abs(value):
        return in_digits(value, 4)  # a fit that leaves nothing over: no uncertainty was found
    digits = 1 - math.floor(math.log10(sd))
    if digits > _FINEST:
        power = digits - 2
        both = with_uncertainty(value * 10.0**power, sd * 10.0**power)
        return f"({both})·10{_raised(-power)}"
    shown = max(0, digits)
    return f"{round(value, digits) + 0.0:.{shown}f} ± {round(sd, digits):.{shown}f}"


def in_digits(value: float, digits: int = 3, *, sign: bool = False) -> str:
    """A number in significant digits as people write it: never 4.66e+03, and 0 for 5e-16.

    Parameters
    ----------
    value
        The number.
    digits
        Significant ones; those before the point are all written.
    sign
        Whether a plus sign is written too.

    >>> [in_digits(v) for v in (4664.2, 0.012345, -20.0, 5.18e-16, 1.5e-7, float("nan"))]
    ['4664', '0.0123', '-20', '0', '1.5·10⁻⁷', 'nan']
    """
    if not math.isfinite(value):
        return f"{value}"
    if abs(value) < _NOTHING:
        return "0"
    plus = "+" if sign else "-"
    mantissa, _, exponent = f"{value:{plus}.{digits - 1}e}".partition("e")
    power = int(exponent)
    if -_FINEST < power < _LARGEST:
        text = f"{value:{plus}.{max(0, digits - 1 - power)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}·10{_raised(power)}"


def _raised(power: int) -> str:
    """A power's digits, set high."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


_FINEST = 6
"""Decimals that people still read; smaller numbers are written with a power of ten."""
_LARGEST = 7
"""Digits before the point likewise."""
_NOTHING = 1e-12
"""What is smaller in any unit that people read is what a computer leaves of nothing."""
