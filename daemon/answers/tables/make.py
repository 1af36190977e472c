"""Tables for a controller, what they leave of the error, and their record."""

from __future__ import annotations

import getpass
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.table_set import TableSet, read_text, sha256
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.model.to_enter import average_line_words
from abbe.compcore.model.uncertainty import (
    COVERAGE,
    PredictionUncertainty,
    in_words,
    uncertainty,
)
from abbe.compcore.tables import record as records
from abbe.compcore.tables.angle_left import angle_left
from abbe.compcore.tables.capability import RIGID
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.project import TOLERANCE, project
from abbe.compcore.tables.remainder import Remainder, TrialPoints
from abbe.compcore.tables.table import Table
from abbe.compcore.tables.volume import Volume
from abbe.daemon.answers.inputs import now
from abbe.daemon.answers.switches import not_applied
from abbe.daemon.installed import abbe_version
from abbe.drivers.controllers import Controller

F64 = NDArray[np.float64]

NONE = "no compensation"
IDEAL = "without limits"
FULL = "L-VOL"
SINGLE = "without products"


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
    request
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

    request: TableRequest
    model: Model
    made: TableSet
    new: tuple[Table, ...]
    remaining: Mapping[str, Remainder]
    notes: tuple[str, ...]
    trial: TrialPoints
    sure: PredictionUncertainty | None


def make(request: TableRequest, model: Model | None = None) -> TableAnswer:
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
        return _made(request, model)


def _made(request: TableRequest, model: Model | None) -> TableAnswer:
    whole = load_model(request.model_path) if model is None else model
    model = whole.switched()
    controller, volume = request.controller, request.volume
    capability = controller.capability
    error = ErrorField(model, request.state, capability.lookup)
    present = controller.read(request.present) if request.present else ()
    found = project(
        error,
        volume,
        capability,
        points=request.points,
        tolerance=request.tolerance,
        present=present,
        orientation=request.orientation,
    )
    tables = controller.adapted(found.tables)
    files = controller.write(tables)
    new = _less(tables, present)
    trial = TrialPoints.over(error, volume)
    sure = uncertainty(model, error.conditions(trial.positions, trial.directions))
    remaining = {NONE: trial.remainder()}
    if capability.form("product") is not None:
        single = project(
            error, volume, capability.without("product"), points=request.points,
            tolerance=request.tolerance, orientation=request.orientation,
        )  # fmt: skip
        remaining[SINGLE] = trial.remainder(single.tables)
    remaining[controller.name] = trial.remainder(new)
    if capability.form("grid") is None:
        ideal = project(
            error, volume, capability.unlimited(), orientation=request.orientation
        ).tables
        remaining[IDEAL] = trial.remainder(ideal)
    if not {"L-VOL", "L-VOL+"} & set(capability.types):
        remaining[FULL] = trial.remainder(project(error, volume, RIGID).tables)
    lines = tuple(average_line_words(model))
    said = (
        [request.note] if request.note else [],
        not_applied(whole),
        found.notes,
        _of_a_lathe(tables, model),
        _without_axis(model),
        _angles(trial, new),
        lines,
        in_words(sure),
    )
    notes = tuple(dict.fromkeys(itertools.chain(*said)))
    record = records.full_record(
        model=records.model_record(
            model, str(request.model_path), sha256(read_text(request.model_path))
        ),
        conditions=records.conditions_record(error, volume),
        tables=records.tables_record(tables),
        remaining={name: records.remainder_record(r) for name, r in remaining.items()},
        made=now(),
        by=request.by or _user(),
        abbe=abbe_version(),
        notes=notes,
        sign=controller.sign,
        trust=controller.trust.as_dict(),
        superposed={name: sha256(text) for name, text in request.present.items()},
        uncertainty=_sure_json(sure),
    )
    made = TableSet(controller.name, dict(request.options), files, record, tuple(tables))
    return TableAnswer(request, model, made, new, remaining, notes, trial, sure)


def _without_axis(model: Model) -> list[str]:
    """What the remaining error does not count: directions in which the machine has no axis."""
    missing = [a for a in "XYZ" if a not in model.machine.structure.carrying]
    if not missing:
        return []
    return [
        f"errors along {' and '.join(missing)}, where the machine has no linear axis, are not "
        "counted in what is left: abbe correct says how large they are at a point"
    ]


def _angles(trial: TrialPoints, tables: Sequence[Table]) -> list[str]:
    """What is left of the angles of a rotary table or head alone, whose points move by no axis."""
    structure = trial.field.model.machine.structure
    if structure.carrying:
        return []
    said = []
    for axis in structure.rotary:
        none, left = (angle_left(trial, axis, made) * 1e6 for made in ((), tables))
        said.append(
            f"{axis}: of its angle {np.abs(none).max():.1f} µrad at most, {none.std():.1f} rms, "
            f"without compensation, {np.abs(left).max():.1f} and {left.std():.1f} with these "
            "tables (a turn of the whole taken off)"
        )
    return said


def _of_a_lathe(tables: Sequence[Table], model: Model) -> list[str]:
    """What a lathe's X means in the tables."""
    uses_x = any("X" in t.inputs or t.output.component == "X" for t in tables)
    if not (uses_x and model.machine.structure.shows_diameters):
        return []
    return [
        "X is a radius here, the travel of the slide: a control that counts X in diameters may "
        "want positions, and perhaps values, twice as large; its manual says, and an indicator "
        "shows"
    ]


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


def lengths(sure: PredictionUncertainty) -> F64:
    """± of the error vector's length all over the volume, k = 2, (n,), mm."""
    return np.asarray(COVERAGE * np.linalg.norm(sure.translation, axis=1))


def _sure_json(sure: PredictionUncertainty | None) -> dict[str, Any] | None:
    if sure is None:
        return None
    wide = lengths(sure) * 1e3
    return {
        "largest": float(wide.max()),
        "rms": float(np.sqrt((wide**2).mean())),
        "unit": "um",
        "k": COVERAGE,
        "beyond": [b.name for b in sure.beyond],
    }
