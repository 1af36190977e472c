"""Compensation tables of a model for a controller, in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from abbe.compcore.errors import require_type
from abbe.compcore.model.model import Model
from abbe.compcore.tables.capability import Capability
from abbe.compcore.tables.field import ErrorField, table_state
from abbe.compcore.tables.projection.project import TOLERANCE, Projection, project
from abbe.compcore.tables.table import Table
from abbe.compcore.tables.volume import Volume


def project_tables(
    model: Model,
    capability: Capability,
    *,
    signals: Mapping[str, float] | None = None,
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    time: float = 0.0,
    volume: Mapping[str, tuple[float, float]] | None = None,
    points: int | None = None,
    tolerance: float = TOLERANCE,
    present: Sequence[Table] = (),
    orientation: bool = False,
) -> Projection:
    """The compensation tables that leave least of a model's error, within a controller's limits.

    Parameters
    ----------
    model
        A fitted model.
    capability
        What the controller holds: ``make_controller("fanuc", machine).capability``.
    signals
        Every signal that the model reads, in its own unit: tables hold at stated temperatures.
    tool
        Tool or probe offset, mm, machine axes.
    time
        s on the model's clock, for effects that drift.
    volume
        Axis → range in which the error counts, mm (rotary: rad); else its whole travel.
    points
        Most points of a table; None: as many as it takes.
    tolerance
        Interpolation error at the functional point that is small enough, mm.
    present
        Tables that were active while the model was measured; the new ones are added to them.
    orientation
        Whether tables of rotary axes hold the tool's direction too.

    Returns
    -------
    Projection
        Tables of errors (mm or rad), and notes where the controller's limits were felt.

    Raises
    ------
    InputError
        When a signal that the model reads is not stated, a range leaves an axis's travel, or
        `points` is more than the controller holds.
    """
    require_type(model, Model, "model")
    require_type(capability, Capability, "capability")
    state = table_state(model, signals or {}, tool=tool, time=time)
    return project(
        ErrorField(model, state, capability.lookup),
        Volume.of(model.machine, volume),
        capability,
        points=points,
        tolerance=tolerance,
        present=present,
        orientation=orientation,
    )
