"""Decimal numbers from text, many at once and exactly.

A number of at most 15 or so digits with a point is its digits as a whole number, exact in binary
below 2^53, divided by a power of ten, exact up to 10^22: one division, rounded once, is the nearest
double (W. D. Clinger, How to read floating point numbers accurately, PLDI 1990). That is what
measurements look like, and it goes a column of characters at a time. Anything else goes through
Python's own `float`, one by one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_LONGEST = 18
_EXACT = 2**53
_POWERS = 10.0 ** np.arange(_LONGEST + 1)
_ZERO, _MINUS, _POINT = np.uint8(ord("0")), np.uint8(ord("-")), np.uint8(ord("."))


def parse_decimals(text: bytes, starts: I64, ends: I64) -> F64 | None:
    """The numbers in the cells ``text[start:end]``, shape (n,); NaN where a cell is empty.

    None when some cell is not a finite number as Python reads one (digits may not be grouped).
    """
    values = np.full(len(starts), np.nan)
    length = ends - starts
    odd = [np.flatnonzero(length > _LONGEST)]
    # cells of one length at a time: each is then a table of characters
    order = np.argsort(np.minimum(length, _LONGEST + 1).astype(np.uint8), kind="stable")
    bounds = np.searchsorted(length[order], np.arange(1, _LONGEST + 2))
    characters = np.frombuffer(text, dtype=np.uint8)
    for size in range(1, _LONGEST + 1):
        rows = order[bounds[size - 1] : bounds[size]]
        if len(rows):
            values[rows], plain = _of_one_length(characters, starts[rows], size)
            odd.append(rows[~plain])
    left = np.concatenate(odd)
    if len(left):
        cells = [text[a:b] for a, b in zip(starts[left].tolist(), ends[left].tolist(), strict=True)]
        if b"_" in b"".join(cells):
            return None
        try:
            found = np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            return None
        if not np.isfinite(found).all():
            return None
        values[left] = found
    return values


def _of_one_length(
    characters: NDArray[np.uint8], start: I64, size: int
) -> tuple[F64, NDArray[np.bool_]]:
    """Numbers of `size` characters, and which of them are plain decimals."""
    n = len(start)
    whole = np.zeros(n, dtype=np.int64)
    digits = np.zeros(n, dtype=np.int8)
    after_point = np.zeros(n, dtype=np.int8)
    point = np.zeros(n, dtype=np.bool_)
    negative = characters[start] == _MINUS
    plain = np.ones(n, dtype=np.bool_)
    for i in range(size):
        character = characters[start + i]
        digit = character - _ZERO  # wraps round below '0'
        is_digit = digit < 10
        is_point = character == _POINT
        np.multiply(whole, 10, out=whole, where=is_digit)
        np.add(whole, digit, out=whole, where=is_digit)
        digits += is_digit
        after_point += is_digit & point
        plain &= is_digit | (is_point & ~point) | (negative if i == 0 else False)
        point |= is_point
    plain &= (digits > 0) & (whole < _EXACT)
    values = whole / _POWERS[after_point]
    return np.where(negative, -values, values), plain
