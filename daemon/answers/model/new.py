"""The answer of ``abbe new``: what the start model holds and what to measure; JSON and text."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from abbe.compcore.campaign.misplaced_tools import joints
from abbe.compcore.machine.machine import Axis
from abbe.compcore.model.model import Model
from abbe.compcore.model.start_model import bare
from abbe.daemon.answers.typed import finding, fitting

_ALONG = str.maketrans("ABC", "XYZ")
"""A rotary axis → the linear one along which its line lies."""


def columns_of(model: Model) -> list[str]:
    """The columns that a campaign for this model has."""
    machine = model.machine
    axes = list(machine.structure.axes)
    used = {a for e in model.effects for a in e.directions_used()}
    # where nothing is known yet, play is looked for in every axis
    directions = axes if bare(model) else sorted(used, key=axes.index)
    return [
        *("time", "setup", "kind", *axes),
        *(f"{axis}_dir" for axis in directions),
        *("tool_x", "tool_y", "tool_z", "ux", "uy", "uz", "value", "sd"),
        *machine.signals,
    ]


def as_json(model: Model, out: Path) -> dict[str, Any]:
    """One object for ``--json``; travels in mm, rotary axes degrees."""
    machine = model.machine
    return {
        "file": str(out),
        "name": machine.name,
        "structure": str(machine.structure),
        "travels": {name: list(_ends(axis)) for name, axis in machine.axes.items()},
        "signals": {s.name: {"role": s.role, "unit": s.unit} for s in machine.signals.values()},
        "effects": [effect.spec for effect in model.effects],
        "parameters": _parameters(model),
        "columns": columns_of(model),
    }


def as_text(model: Model, out: Path) -> Iterator[str]:
    """Lines for people."""
    machine = model.machine
    held = f"{len(model.effects)} effects with {_parameters(model)} parameters, none of them fitted"
    yield f"{machine.name}, {machine.structure}: {held if model.effects else 'no effects'}"
    used = {signal for effect in model.effects for signal in effect.signals_needed()}
    for axis in machine.axes.values():
        low, high = _ends(axis)
        yield f"  {axis.name}: {low:g} to {high:g} {'degrees' if axis.rotary else 'mm'}"
    for signal in machine.signals.values():
        use = "used" if signal.name in used else "recorded, for abbe diagnose"
        yield f"  {signal.name}: {signal.role}, {signal.unit}, {use}"
    if chain := joints(machine):
        last = chain[-1]
        where = ", ".join(f"{v:g}" for v in machine.axes[last].location)
        yield (
            "tools (tool_x, tool_y, tool_z, tool=): where the tip is with all joints at zero, mm "
            f"from the machine's origin, not from the flange; {last} then turns about a line along "
            f"{last[0].translate(_ALONG)} through {where}"
        )
    yield "columns of a campaign (docs/campaigns.md): " + ",".join(columns_of(model))
    yield f"next: measure, and  {finding(out) if bare(model) else fitting(out)}"


def _parameters(model: Model) -> int:
    machine = model.machine
    return sum(len(e.linear(machine)) + len(e.nonlinear(machine)) for e in model.effects)


def _ends(axis: Axis) -> tuple[float, float]:
    scale = math.degrees(1.0) if axis.rotary else 1.0
    return round(axis.travel[0] * scale, 9), round(axis.travel[1] * scale, 9)
