"""Types of where-keys: what a model file holds as a list, a command line gives comma-separated."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from abbe.compcore.errors import InputError


def _comma_separated(value: object) -> object:
    return tuple(part.strip() for part in value.split(",")) if isinstance(value, str) else value


def _time_constant(value: object) -> object:
    if value is None or value == "fit":
        return value
    try:
        seconds = float(str(value))
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise InputError("not a time constant", found=value, expected="seconds above 0, or fit")
    return seconds


def _none_if_fit(value: object) -> object:
    return None if value == "fit" else value


Finite = Annotated[float, Field(allow_inf_nan=False)]
"""A number."""

Names = Annotated[tuple[str, ...], BeforeValidator(_comma_separated), Field(min_length=1)]
"""One or more names."""

OptionalNames = Annotated[tuple[str, ...], BeforeValidator(_comma_separated)]
"""Any number of names, also none."""

Pair = Annotated[tuple[str, str], BeforeValidator(_comma_separated)]
"""Two names."""

Numbers = Annotated[tuple[Finite, ...], BeforeValidator(_comma_separated)]
"""Any number of numbers."""

Vector = Annotated[tuple[Finite, Finite, Finite], BeforeValidator(_comma_separated)]
"""Three numbers."""

Harmonics = Annotated[int, Field(ge=1, le=32)]
"""The number of harmonics: 1 … this one."""

Tau = Annotated[float | Literal["fit"] | None, BeforeValidator(_time_constant)]
"""A time constant in s, ``fit`` to have it fitted, or None for no lag."""

FittedUnlessGiven = Annotated[Finite | None, BeforeValidator(_none_if_fit)]
"""A number that is fitted unless it is given; ``fit`` says so aloud."""

PositiveUnlessFitted = Annotated[
    Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None, BeforeValidator(_none_if_fit)
]
"""The same for a number above zero."""
