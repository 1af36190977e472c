"""Rotary axes as they are built, beside an answer's errors: as JSON.

Errors are of the tool relative to the workpiece. Where a rotary axis' line lies, what to enter for
it, and what one measures on a table itself, follows from them and is said here for all commands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.as_built import (
    ON_THE_TABLE,
    AverageLine,
    average_lines,
    reversed_parameters,
)
from abbe.compcore.model.held_spindle import HeldSpindle, where_they_are
from abbe.compcore.model.model import Model, Value


def lines_json(model: Model) -> list[dict[str, Any]]:
    """Where the lines of rotary axes lie and what to enter for them; one entry an axis."""
    return [line_json(line) for line in average_lines(where_they_are(model))]


def line_json(line: AverageLine) -> dict[str, Any]:
    """Where one line lies and what to enter for it."""
    across = [("XYZ"[k], k) for k in line.across]
    return {
        "axis": line.axis,
        "side": line.side,
        "unit": "mm",
        "configured": {d: float(line.configured[k]) for d, k in across},
        "enter": {d: float(line.place[k]) for d, k in across},
        "offset": {d: float(line.offset[k]) for d, k in across},
        "sd": {
            d: _finite(float(line.offset_sd[k])) if line.measured[k] else None for d, k in across
        },
        "direction": [float(v) for v in line.direction],
        "lean": {"unit": "rad", **{d: float(line.lean[k]) for d, k in across}},
        "lean_sd": {"unit": "rad", **{d: _finite(float(line.lean_sd[k])) for d, k in across}},
        "zero": {"unit": "rad", "value": line.zero, "sd": _finite(line.zero_sd)},
        "carried_by": line.carrier,
        "offset_from_carrier": {d: float(line.beside_carrier[k]) for d, k in across},
        "text": list(line.words()),
    }


def spindle_json(held: HeldSpindle | None) -> dict[str, Any] | None:
    """Where a head holds its spindle and what to enter for it; None where nothing was found."""
    if held is None:
        return None
    return {
        "from_the_line_of": held.axis,
        "unit": "mm",
        "configured": {d: float(held.configured[k]) for k, d in enumerate("XYZ")},
        "enter": {"XYZ"[k]: float(held.place[k]) for k in held.entered},
        "offset": {d: float(held.offset[k]) for k, d in enumerate("XYZ") if held.measured[k]},
        "sd": {
            d: _finite(float(held.offset_sd[k])) for k, d in enumerate("XYZ") if held.measured[k]
        },
        "with_tool": [float(v) for v in held.tool],
        "text": list(held.words()),
    }


def seen_json(
    machine: Machine, effect: Effect, values: Mapping[str, Value]
) -> dict[str, Any] | None:
    """What of an effect one measures on the table itself; None on the tool side."""
    names = reversed_parameters(machine, effect)
    if not names or not values:
        return None
    return {
        "text": ON_THE_TABLE,
        "parameters": {
            p.name: {"value": -values[p.name].value, "sd": values[p.name].sd, "unit": p.unit}
            for p in effect.linear(machine)
            if p.name in values
        },
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
