"""Numbers in the files of controllers: written without surprises, read with the place of errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.numbers import checked_number

F64 = NDArray[np.float64]


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, zero never negative.

    >>> fixed(-0.00001, 3), fixed(12.5, 1)
    ('0.000', '12.5')
    """
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def whole(value: float, step: float, what: str) -> int:
    """A value as a number of steps.

    Raises
    ------
    ValueError
        When it is not one: tables come here in whole steps.
    """
    count = value / step
    if abs(count - round(count)) > 1e-4:
        raise ValueError(f"{what}: {value!r} is not a whole number of {step!r}")
    return round(count)


def number(text: str, file: str, line: int | None, what: str) -> float:
    """A finite number.

    Raises
    ------
    InputError
        With the place.
    """
    return checked_number(text, file=file, line=line, field=what, expected="a number")


def whole_number(text: str, file: str, line: int | None, what: str) -> int:
    """A whole number.

    Raises
    ------
    InputError
        With the place.
    """
    value = number(text, file, line, what)
    if value != int(value):
        raise InputError(
            "not a whole number", file=file, line=line, field=what, found=text,
            expected="a whole number",
        )  # fmt: skip
    return int(value)


def above_zero(value: float, file: str, line: int | None, what: str) -> float:
    """A number that must be greater than 0, such as a distance.

    Raises
    ------
    InputError
        With the place.
    """
    if not value > 0.0:
        raise InputError(
            "not above 0", file=file, line=line, field=what, found=value, expected="above 0"
        )
    return value


def only_file(files: Mapping[str, str]) -> tuple[str, str]:
    """Name and text of the one file that a dialect has.

    Raises
    ------
    InputError
        When there are several.
    """
    if len(files) != 1:
        raise InputError(
            "more than one file", found=", ".join(sorted(files)), expected="one with all tables"
        )
    return next(iter(files.items()))


def numbered_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, from 1, without line ends and blanks around."""
    for i, line in enumerate(text.splitlines(), start=1):
        yield i, line.strip()


def increasing(positions: Sequence[float], file: str, line: int, what: str) -> F64:
    """Positions of a table.

    Raises
    ------
    InputError
        When there are none, or they do not increase.
    """
    found = np.array(positions, dtype=np.float64)
    if not len(found) or (np.diff(found) <= 0.0).any():
        raise InputError(
            "positions do not increase" if len(found) else "no points",
            file=file,
            line=line,
            field=what,
            expected="one point or more, each beyond the one before",
        )
    return found
