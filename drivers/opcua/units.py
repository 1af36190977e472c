"""Engineering units of OPC UA (Part 8, 5.6.4.3): codes of UNECE Recommendation 20 as numbers."""

from __future__ import annotations

NAMESPACE = "http://www.opcfoundation.org/UA/units/un/cefact"
"""URI of a unit whose number is a code of UNECE's."""

_CODES = {
    "nm": "C45", "um": "4H", "µm": "4H", "mm": "MMT", "cm": "CMT", "m": "MTR", "in": "INH",
    "urad": "B97", "µrad": "B97", "mrad": "C25", "rad": "C81", "arcsec": "D62", "deg": "DD",
    "degC": "CEL", "degF": "FAH", "K": "KEL",
    "rpm": "RPM", "1/min": "RPM", "mm/s": "C16", "mm/min": "H81", "N": "NEW", "Nm": "NU",
    "kg": "KGM", "%": "P1", "Pa": "PAL", "hPa": "A97", "kPa": "KPA", "bar": "BAR", "V": "VLT",
    "A": "AMP", "s": "SEC", "ms": "C26",
}  # fmt: skip


def number_of(code: str) -> int:
    """A code of up to four characters as the number that OPC UA gives it.

    >>> number_of("MMT"), number_of("CEL")
    (5066068, 4408652)
    """
    return int.from_bytes(code.encode("ascii"), "big")


_BY_NUMBER = {number_of(code): unit for unit, code in reversed(_CODES.items())}


def number_for(unit: str) -> int | None:
    """The number of a unit in Abbe's spelling; None: it has none."""
    return number_of(_CODES[unit]) if unit in _CODES else None


def stated(number: int, namespace: str, name: str) -> str:
    """The unit that a server states, in Abbe's spelling; else its own name for it."""
    if namespace == NAMESPACE and number in _BY_NUMBER:
        return _BY_NUMBER[number]
    return name


def contradicts(unit: str, number: int, namespace: str) -> bool:
    """Whether a unit that is configured is surely another one than the server states."""
    known = namespace == NAMESPACE and number > 0 and unit in _CODES
    return known and number_of(_CODES[unit]) != number
