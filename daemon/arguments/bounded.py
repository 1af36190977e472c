"""Numbers of the command line within bounds: what is not finite or absurd is wrong usage."""

from __future__ import annotations

from collections.abc import Callable

import typer


def within(low: float, high: float, unit: str) -> Callable[[float | None], float | None]:
    """What checks an option: a number from `low` to `high`, or none given.

    Raises
    ------
    typer.BadParameter
        Naming what was found and what is allowed.
    """

    def check(value: float | None) -> float | None:
        if value is None or low <= value <= high:
            return value
        raise typer.BadParameter(f"found {value:g}, expected {low:g} to {high:g} {unit}")

    return check
