"""The answer of ``abbe table`` as JSON and as text: tables, what they leave, how sure that is."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.uncertainty import COVERAGE, UNKNOWN
from abbe.compcore.sentences import said
from abbe.compcore.tables.compensation_types import on_machine, types_needed
from abbe.compcore.tables.projection.orientation import pointing_axes
from abbe.compcore.tables.remainder import Remainder
from abbe.daemon.answers import as_built
from abbe.daemon.answers.tables.make import FULL, IDEAL, NONE, SINGLE, TableAnswer, lengths
from abbe.drivers.controllers import Confidence, Controller

_LEAN = 1e-7
"""rad: a lean that is worth saying."""
_WORTH = 1e-4
"""mm: what limits cost is reported from here on."""

_SURE = {
    Confidence.TRIED: said("tried"),
    Confidence.DOCUMENTED: said("documented"),
    Confidence.UNVERIFIED: said("unverified"),
}


def as_json(done: TableAnswer, written: Sequence[Path]) -> dict[str, Any]:
    """One object for ``--json``."""
    controller = done.request.controller
    needed = types_needed(done.model)
    return {
        "controller": controller.name,
        "title": controller.title,
        "types": list(held_types(done)),
        "types_needed": list(needed.types),
        "beyond_tables": sorted({m.effect for m in needed.beyond}),
        "sign": controller.sign,
        "trust": controller.trust.as_dict(),
        "activation": list(controller.activation()),
        "rotary_axes": as_built.lines_json(done.model),
        "written": [str(p) for p in written],
        **done.made.document(),
    }


def as_text(done: TableAnswer, written: Sequence[Path]) -> Iterator[str]:
    """Lines for people."""
    controller = done.request.controller
    needed = types_needed(done.model)
    yield f"{controller.name}: {controller.title}"
    yield (
        f"holds {', '.join(held_types(done))}; "
        f"the model's errors would take {', '.join(needed.types) or 'nothing'}"
    )
    if needed.beyond:
        effects = ", ".join(sorted({m.effect for m in needed.beyond}))
        yield f"beyond all tables over single axes: {effects}"
    yield f"sign of the numbers: {controller.sign}"
    yield from trust_lines(controller)
    yield ""
    yield "Tables" + _conditions(done)
    for row in done.made.record["tables"]:
        size = "×".join(str(n) for n in row["points"])
        ways = ", two directions" if row["directions"] == 2 else ""
        unit = row["unit"].replace("u", "µ", 1)
        yield f"  {row['table']:<10} {size:>7} points{ways}, largest {row['largest']:.1f} {unit}"
    yield ""
    # of a rotary table alone the notes say it, in angles
    if done.model.machine.structure.carrying:
        yield "Left of the error in the working volume (a shift of the whole taken off), µm:"
        rows = remaining_rows(done)
        wide = max(34, *(len(name) for name, _ in rows))
        yield f"  {'':<{wide}}{'largest':>9}{'rms':>9}"
        for name, left in rows:
            yield f"  {name:<{wide}}{left.largest * 1e3:>9.1f}{left.rms * 1e3:>9.1f}"
    own, none = done.remaining[controller.name], done.remaining[NONE]
    leans = f"The tool leans by {none.lean_rms * 1e6:.1f} µrad (rms)"
    if pointing_axes(done.model.machine):
        yield f"{leans} without compensation, by {own.lean_rms * 1e6:.1f} µrad with these tables"
    elif none.lean_rms > _LEAN:
        yield f"{leans}, and no axis of this machine can turn it back"
    yield _sure_line(done)
    for note in done.notes:
        yield f"note: {note}"
    yield ""
    yield "At the controller:"
    for step in controller.activation():
        yield f"  - {step}"
    yield "written: " + ", ".join(str(p) for p in written)


def _sure_line(done: TableAnswer) -> str:
    if done.sure is None:
        return f"How sure the model is: {UNKNOWN}"
    wide = lengths(done.sure) * 1e3
    return (
        f"How sure the model is there: ± {wide.max():.1f} µm at most, "
        f"± {np.sqrt((wide**2).mean()):.1f} rms (k = {COVERAGE:g})"
    )


def trust_lines(controller: Controller) -> Iterator[str]:
    """How sure Abbe is of a dialect, with a warning where it is not."""
    trust = controller.trust
    yield (
        said(
            "how sure: syntax {syntax}, sign {sign}, activation {activation}",
            syntax=_SURE[trust.syntax],
            sign=_SURE[trust.sign],
            activation=_SURE[trust.activation],
        )
        if not trust.note
        else f"how sure: syntax {trust.syntax}, sign {trust.sign}, activation {trust.activation} "
        f"({trust.note})"
    )
    if trust.least is Confidence.UNVERIFIED:
        yield (
            "WARNING: not all of this has been tried on a machine or read in the maker's manual. A "
            "wrong sign doubles the error: check one point with an indicator first."
        )


def remaining_rows(done: TableAnswer) -> list[tuple[str, Remainder]]:
    """What is left, named for people."""
    controller = done.request.controller
    names = names_of_remaining(controller, done.model.machine, done.remaining)
    own = done.remaining[controller.name]
    return [
        (names[key], left)
        for key, left in done.remaining.items()
        if key != IDEAL or left.largest < own.largest - _WORTH
    ]


def names_of_remaining(
    controller: Controller, machine: Machine, remaining: Collection[str]
) -> dict[str, str]:
    """What a remainder is of → its name for people."""
    types = "+".join(on_machine(controller.capability.types, machine)[:2])
    products = " with products" if SINGLE in remaining else ""
    return {
        NONE: NONE,
        SINGLE: f"{controller.name}, {types}",
        controller.name: f"{controller.name}, {types}{products}",
        IDEAL: f"{types}{products} without limits",
        FULL: "L-VOL (a controller with levers)",
    }


def held_types(done: TableAnswer) -> tuple[str, ...]:
    """Types of the controller that this machine can use."""
    return on_machine(done.request.controller.capability.types, done.model.machine)


def _conditions(done: TableAnswer) -> str:
    state, machine = done.request.state, done.model.machine
    parts = [
        f"{name} {value:g} {machine.signals[name].unit if name in machine.signals else ''}".strip()
        for name, value in state.signals.items()
    ]
    parts.append("tool " + ", ".join(f"{v:g}" for v in state.tool) + " mm")
    return " at " + "; ".join(parts)
