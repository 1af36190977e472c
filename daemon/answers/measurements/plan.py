"""The answer of ``abbe plan`` as JSON and as text: mm and degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from abbe.compcore.campaign.plan import PlannedMeasurement, PlannedSteps
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import joined, said


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
    text = said(
        "{way} every {step}, {count} targets", way=f"{axis} {first:.6g} … {last:.6g}{unit}",
        step=f"{_shown(axis, steps.step):.6g}{unit}", count=steps.targets,
    )  # fmt: skip
    if steps.uneven:
        text = said("{targets}, each moved by a random part of a step", targets=text)
    if steps.wave is not None and steps.held is not None:
        text = said(
            "{targets}; holds {part} % of a wave of {length}", targets=text,
            part=f"{steps.held * 100:.0f}", length=f"{_shown(axis, steps.wave):.6g}{unit}",
        )  # fmt: skip
    shortest = f"{_shown(axis, steps.shortest):.6g}{unit}"
    return said("{targets}; no wave shorter than {length}", targets=text, length=shortest)


def standing_words(planned: PlannedMeasurement) -> str:
    """Where the other axes stand: ``Y 450, Z −180 mm``."""
    return ", ".join(f"{a} {_shown(a, v):.6g}{_unit(a)}" for a, v in planned.at.items())


BEFORE = (
    said("warm up as in use; compensations of geometry off, of temperature on (ISO/TR 16907, 8.3)"),
    said("write down instrument, load, feed, tool, operator, active compensations (9.1)"),
)
AFTER = said("check afterwards on other lines and with other tools than these (11.3): abbe compare")


def as_text(machine: Machine, plan: Sequence[PlannedMeasurement]) -> Iterator[str]:
    """Lines for people."""
    yield said(
        "Measurements of {name}, {structure}, in the order of ISO/TR 16907, 10.3",
        name=machine.name or said("this machine"), structure=machine.structure,
    )  # fmt: skip
    for line in BEFORE:
        yield said("   before: {what}", what=line)
    if machine.signals:
        yield said("   record with every reading: {signals}", signals=", ".join(machine.signals))
    for i, p in enumerate(plan, start=1):
        yield said(
            "{number} {axis} {what}: {motions}", number=f"{i:>3}", axis=p.axis, what=p.what,
            motions=joined(p.motions, ", "),
        )  # fmt: skip
        by = said("      with {instrument}", instrument=p.instrument)
        yield said("{by}, {runs} runs each way", by=by, runs=p.runs) if p.steps else by
        for steps in p.steps:
            yield said("      {steps}", steps=steps_words(steps))
        if standing := standing_words(p):
            yield said("      at {place}", place=standing)
    yield said("    after: {what}", what=AFTER)
