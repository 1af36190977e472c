"""The answer of ``abbe plan`` as JSON and as text: mm and degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from abbe.compcore.campaign.plan import PlannedMeasurement, PlannedSteps
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import said


def _shown(axis: str, value: float) -> float:
    return math.degrees(value) if is_rotary(axis) else value


def _unit(axis: str) -> str:
    return "°" if is_rotary(axis) else " mm"


def as_json(machine: Machine, plan: Sequence[PlannedMeasurement]) -> dict[str, Any]:
    """One object for ``--json``."""
    return {
        "machine": machine.name,
        "structure": str(machine.structure),
        "record": list(machine.signals),
        "measurements": [
            {
                "number": i,
                "axis": p.axis,
                "what": p.what,
                "motions": list(p.motions),
                "instrument": p.instrument,
                "runs": p.runs,
                "at": {a: _shown(a, v) for a, v in p.at.items()},
                "steps": [_steps(s) for s in p.steps],
            }
            for i, p in enumerate(plan, start=1)
        ],
    }


def _steps(steps: PlannedSteps) -> dict[str, Any]:
    axis = steps.axis
    return {
        "axis": axis,
        "unit": "deg" if is_rotary(axis) else "mm",
        "first": _shown(axis, steps.first),
        "last": _shown(axis, steps.last),
        "step": _shown(axis, steps.step),
        "targets": steps.targets,
        "uneven": steps.uneven,
        "shortest_wave": _shown(axis, steps.shortest),
        "wave": None if steps.wave is None else _shown(axis, steps.wave),
        "held": steps.held,
    }


def steps_words(steps: PlannedSteps) -> str:
    """``X 0 … 700 mm every 50 mm, 15 targets; no wave shorter than 100 mm``."""
    axis, unit = steps.axis, _unit(steps.axis)
    first, last = _shown(axis, steps.first), _shown(axis, steps.last)
    text = f"{axis} {first:.6g} … {last:.6g}{unit} every {_shown(axis, steps.step):.6g}{unit}, "
    text += f"{steps.targets} targets"
    if steps.uneven:
        text += ", each moved by a random part of a step"
    if steps.wave is not None and steps.held is not None:
        text += (
            f"; holds {steps.held * 100:.0f} % of a wave of {_shown(axis, steps.wave):.6g}{unit}"
        )
    return f"{text}; no wave shorter than {_shown(axis, steps.shortest):.6g}{unit}"


def standing_words(planned: PlannedMeasurement) -> str:
    """Where the other axes stand: ``Y 450, Z −180 mm``."""
    return ", ".join(f"{a} {_shown(a, v):.6g}{_unit(a)}" for a, v in planned.at.items())


BEFORE = (
    said("warm up as in use; compensations of geometry off, of temperature on (ISO/TR 16907, 8.3)"),
    said("write down instrument, load, feed, tool, operator, active compensations (9.1)"),
)
AFTER = "check afterwards on other lines and with other tools than these (11.3): abbe compare"


def as_text(machine: Machine, plan: Sequence[PlannedMeasurement]) -> Iterator[str]:
    """Lines for people."""
    name = machine.name or "this machine"
    yield f"Measurements of {name}, {machine.structure}, in the order of ISO/TR 16907, 10.3"
    for line in BEFORE:
        yield f"   before: {line}"
    if machine.signals:
        yield f"   record with every reading: {', '.join(machine.signals)}"
    for i, p in enumerate(plan, start=1):
        yield f"{i:>3} {p.axis} {p.what}: {', '.join(p.motions)}"
        runs = f", {p.runs} runs each way" if p.steps else ""
        yield f"      with {p.instrument}{runs}"
        for steps in p.steps:
            yield f"      {steps_words(steps)}"
        if standing := standing_words(p):
            yield f"      at {standing}"
    yield f"    after: {AFTER}"
