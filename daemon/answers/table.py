"""``abbe table``: tables for a controller, what they leave of the error, and their record."""

from __future__ import annotations

import getpass
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.table_set import TableSet, read_text, sha256
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.as_built import average_line_words
from abbe.compcore.model.model import Model
from abbe.compcore.model.uncertainty import (
    COVERAGE,
    UNKNOWN,
    PredictionUncertainty,
    in_words,
    uncertainty,
)
from abbe.compcore.tables import record as records
from abbe.compcore.tables.capability import RIGID
from abbe.compcore.tables.compensation_types import on_machine, types_needed
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.orientation import pointing_axes
from abbe.compcore.tables.projection.project import TOLERANCE, project
from abbe.compcore.tables.remainder import Remainder, TrialPoints
from abbe.compcore.tables.table import Table
from abbe.compcore.tables.volume import Volume
from abbe.daemon.answers import as_built
from abbe.daemon.answers.inputs import abbe_version, now
from abbe.daemon.answers.switches import not_applied
from abbe.drivers.controllers import Confidence, Controller

F64 = NDArray[np.float64]

NONE = "no compensation"
IDEAL = "without limits"
FULL = "L-VOL"
SINGLE = "without products"
_LEAN = 1e-7
"""rad: a lean that is worth saying"""
_WORTH = 1e-4
"""mm: what limits cost is told from here on."""


@dataclass(frozen=True)
class TableRequest:
    """The request for tables: of which model, for which controller and conditions.

    Attributes
    ----------
    model_path
        The model file; the record names it with its SHA-256.
    controller
        The dialect.
    options
        What was set of its options, for the record.
    state
        Temperatures, tool and the rest.
    volume
        The working volume.
    points
        Most points of a table; None: as many as it takes.
    tolerance
        Interpolation error that need not be bettered, mm.
    present
        Files of the tables that were active while the model was measured.
    by, note
        Who, and a remark, for the record.
    orientation
        Whether tables of rotary axes hold the tool's direction too.
    """

    model_path: Path
    controller: Controller
    options: Mapping[str, Any]
    state: SlowState
    volume: Volume
    points: int | None = None
    tolerance: float = TOLERANCE
    present: Mapping[str, str] = field(default_factory=dict)
    by: str = ""
    note: str = ""
    orientation: bool = False


@dataclass(frozen=True, eq=False)
class TableAnswer:
    """The answer of ``abbe table``: the tables that were made, and what they leave.

    Attributes
    ----------
    order
        What was wanted.
    model
        The model.
    made
        Tables, files and record.
    new
        What the tables remove of the model's error: the tables less those that were present.
    remaining
        What is left without compensation, with the controller's tables over single axes where it
        also holds products, with these tables, with the same kinds of tables without limits, and
        with all error motions of a rigid machine.
    notes
        Where limits were felt.
    trial
        Points all over the working volume.
    sure
        How sure the model is there; None where nobody knows.
    """

    order: TableRequest
    model: Model
    made: TableSet
    new: tuple[Table, ...]
    remaining: Mapping[str, Remainder]
    notes: tuple[str, ...]
    trial: TrialPoints
    sure: PredictionUncertainty | None


def make(order: TableRequest, model: Model | None = None) -> TableAnswer:
    """Project the model on what the controller holds, write its files, read them back.

    Raises
    ------
    InputError
        For bad files, and for what the controller cannot hold.
    AbbeError
        When the files do not read back as what was written.
    """
    # all its matrices are small: threads would only wait for each other
    with threads_for(0):
        return _made(order, model)


def _made(order: TableRequest, model: Model | None) -> TableAnswer:
    whole = load_model(order.model_path) if model is None else model
    model = whole.switched()
    controller, volume = order.controller, order.volume
    capability = controller.capability
    error = ErrorField(model, order.state, capability.lookup)
    present = controller.read(order.present) if order.present else ()
    found = project(
        error,
        volume,
        capability,
        points=order.points,
        tolerance=order.tolerance,
        present=present,
        orientation=order.orientation,
    )
    tables = controller.adapted(found.tables)
    files = controller.write(tables)
    new = _less(tables, present)
    trial = TrialPoints.over(error, volume)
    sure = uncertainty(model, error.conditions(trial.positions, trial.directions))
    remaining = {NONE: trial.remainder()}
    if capability.form("product") is not None:
        single = project(
            error, volume, capability.without("product"), points=order.points,
            tolerance=order.tolerance, orientation=order.orientation,
        )  # fmt: skip
        remaining[SINGLE] = trial.remainder(single.tables)
    remaining[controller.name] = trial.remainder(new)
    if capability.form("grid") is None:
        ideal = project(error, volume, capability.unlimited(), orientation=order.orientation).tables
        remaining[IDEAL] = trial.remainder(ideal)
    if not {"L-VOL", "L-VOL+"} & set(capability.types):
        remaining[FULL] = trial.remainder(project(error, volume, RIGID).tables)
    lines = tuple(average_line_words(model))
    said = (
        [order.note] if order.note else [],
        not_applied(whole),
        found.notes,
        lines,
        in_words(sure),
    )
    notes = tuple(dict.fromkeys(itertools.chain(*said)))
    record = records.full_record(
        model=records.model_record(
            model, str(order.model_path), sha256(read_text(order.model_path))
        ),
        conditions=records.conditions_record(error, volume),
        tables=records.tables_record(tables),
        remaining={name: records.remainder_record(r) for name, r in remaining.items()},
        made=now(),
        by=order.by or _user(),
        abbe=abbe_version(),
        notes=notes,
        sign=controller.sign,
        trust=controller.trust.as_dict(),
        superposed={name: sha256(text) for name, text in order.present.items()},
        uncertainty=_sure_json(sure),
    )
    made = TableSet(controller.name, dict(order.options), files, record, tuple(tables))
    return TableAnswer(order, model, made, new, remaining, notes, trial, sure)


def _less(tables: Sequence[Table], present: Sequence[Table]) -> tuple[Table, ...]:
    """Tables less those that were there before."""
    found = list(tables)
    for held in present:
        less = held.scaled(-1.0)
        same = next((i for i, t in enumerate(found) if t.same_number(held)), None)
        if same is None:
            found.append(less)
        else:
            found[same] = found[same].plus(less)
    return tuple(found)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""


def as_json(done: TableAnswer, written: Sequence[Path]) -> dict[str, Any]:
    """One object for ``--json``."""
    controller = done.order.controller
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
    controller = done.order.controller
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


def _lengths(sure: PredictionUncertainty) -> F64:
    """± of the error vector's length all over the volume, k = 2, (n,), mm."""
    return np.asarray(COVERAGE * np.linalg.norm(sure.translation, axis=1))


def _sure_line(done: TableAnswer) -> str:
    if done.sure is None:
        return f"How sure the model is: {UNKNOWN}"
    wide = _lengths(done.sure) * 1e3
    return (
        f"How sure the model is there: ± {wide.max():.1f} µm at most, "
        f"± {np.sqrt((wide**2).mean()):.1f} rms (k = {COVERAGE:g})"
    )


def _sure_json(sure: PredictionUncertainty | None) -> dict[str, Any] | None:
    if sure is None:
        return None
    wide = _lengths(sure) * 1e3
    return {
        "largest": float(wide.max()),
        "rms": float(np.sqrt((wide**2).mean())),
        "unit": "um",
        "k": COVERAGE,
        "beyond": [b.name for b in sure.beyond],
    }


def trust_lines(controller: Controller) -> Iterator[str]:
    """How sure Abbe is of a dialect, with a warning where it is not."""
    trust = controller.trust
    yield (
        f"how sure: syntax {trust.syntax}, sign {trust.sign}, activation {trust.activation}"
        + (f" ({trust.note})" if trust.note else "")
    )
    if trust.least is Confidence.UNVERIFIED:
        yield (
            "WARNING: not all of this has been tried on a machine or read in the maker's manual. A "
            "wrong sign doubles the error: check one point with an indicator first."
        )


def remaining_rows(done: TableAnswer) -> list[tuple[str, Remainder]]:
    """What is left, named for people."""
    controller = done.order.controller
    types = "+".join(held_types(done)[:2])
    products = " with products" if SINGLE in done.remaining else ""
    names = {
        NONE: NONE,
        SINGLE: f"{controller.name}, {types}",
        controller.name: f"{controller.name}, {types}{products}",
        IDEAL: f"{types}{products} without limits",
        FULL: "L-VOL (a controller with levers)",
    }
    own = done.remaining[controller.name]
    return [
        (names[key], left)
        for key, left in done.remaining.items()
        if key != IDEAL or left.largest < own.largest - _WORTH
    ]


def held_types(done: TableAnswer) -> tuple[str, ...]:
    """Types of the controller that this machine can use."""
    return on_machine(done.order.controller.capability.types, done.model.machine)


def _conditions(done: TableAnswer) -> str:
    state, machine = done.order.state, done.model.machine
    parts = [
        f"{name} {value:g} {machine.signals[name].unit if name in machine.signals else ''}".strip()
        for name, value in state.signals.items()
    ]
    parts.append("tool " + ", ".join(f"{v:g}" for v in state.tool) + " mm")
    return " at " + "; ".join(parts)
