"""Ranges of axes on the command line: ``X=0,400``."""

from __future__ import annotations

import math
from collections.abc import Sequence

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import position_range
from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.arguments.assignments import number, split_assignments


def ranges(
    arguments: Sequence[str], machine: Machine, option: str = "volume"
) -> dict[str, tuple[float, float]]:
    """``["X=0,400", "C=-90,90"]`` → ranges, mm (rotary: rad); `option` gave them.

    Raises
    ------
    InputError
        For what cannot be read, or an axis that the machine lacks.
    """
    found = {}
    for name, text in split_assignments(arguments).items():
        machine.axis(name, option)
        parts = text.split(",")
        unit = "degrees" if is_rotary(name) else "mm"
        if len(parts) != 2:
            raise InputError(
                "not a range", field=f"{option} {name}", found=text, expected=f"low,high in {unit}"
            )
        factor = math.pi / 180.0 if is_rotary(name) else 1.0
        allowed = position_range(machine.axis(name))
        low, high = (number(f"{option} {name}", part, unit, allowed) * factor for part in parts)
        found[name] = (low, high)
    return found
