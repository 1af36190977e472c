"""Numbers in text: finite, written plainly, within what is believable."""

from __future__ import annotations

import math
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.machine.plausible import Range


def checked_number(
    text: str,
    *,
    file: str | Path | None = None,
    line: int | None = None,
    field: str | None = None,
    expected: str = "a finite number",
    allowed: Range | None = None,
) -> float:
    """A finite number from its text.

    Parameters
    ----------
    text
        Digits, point, sign and exponent; no underscores between digits, as Python takes them.
    file, line, field
        Where it stands.
    expected
        What stands in its place, as an error says it.
    allowed
        What is believable, in the text's unit.

    Raises
    ------
    InputError
        Naming the place, what was found and what was expected.

    >>> checked_number("-1.5e-3")
    -0.0015
    """
    try:
        value = float(text) if "_" not in text else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            "not a number", file=file, line=line, field=field, found=text, expected=expected
        )
    if allowed is not None and not allowed.holds(value):
        raise InputError(
            "not believable", file=file, line=line, field=field, found=text, expected=str(allowed)
        )
    return value
