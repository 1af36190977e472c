"""The record that goes with a table: what, when, conditions, by whom (ISO/TR 16907, 9.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.remainder import Remainder
from abbe.compcore.tables.table import Table, unit_of_position
from abbe.compcore.tables.volume import Volume


def conditions_record(field: ErrorField, volume: Volume) -> dict[str, Any]:
    """The conditions for which a table holds; units named."""
    machine, state = field.model.machine, field.state
    return {
        "signals": {
            name: {
                "value": value,
                "unit": machine.signals[name].unit if name in machine.signals else "",
            }
            for name, value in state.signals.items()
        },
        "time_s": state.time,
        "tool_mm": list(state.tool),
        "volume": {
            axis: {
                "from": low * unit_of_position(axis)[1],
                "to": high * unit_of_position(axis)[1],
                "unit": unit_of_position(axis)[0],
            }
            for axis, (low, high) in volume.ranges.items()
        },
        "looked_up_at": field.lookup,
    }


def model_record(model: Model, file: str, sha256: str) -> dict[str, Any]:
    """The model in the record: file, checksum, date of the fit, campaigns, their conditions."""
    keep = ("date", "campaigns", "n", "unit", "rms", "noise_floor", "abbe")
    return {
        "file": file,
        "sha256": sha256,
        "machine": model.machine.name,
        "serial": model.machine.serial,
        "structure": str(model.machine.structure),
        "effects": [t.effect.spec for t in model.terms if t.fitted],
        "fit": {k: model.fit[k] for k in keep if k in model.fit},
        "versions_before": len(model.history),
    }


def unit_of_entries(table: Table) -> tuple[str, float]:
    """Unit of a table's values in a record, and the factor to it.

    >>> import numpy as np
    >>> from abbe.compcore.tables.table import move
    >>> unit_of_entries(Table(move("X"), ("Y",), (np.zeros(1),), np.zeros(1), lever=("Z", 0.0)))
    ('um/m', 1000000.0)
    """
    if table.lever is not None:
        return "um/m", 1e6
    return ("urad", 1e6) if table.output.rotation else ("um", 1e3)


def tables_record(tables: Sequence[Table]) -> list[dict[str, Any]]:
    """Each table as one entry of the record: name, points, largest value."""
    found = []
    for table in tables:
        unit, factor = unit_of_entries(table)
        found.append(
            {
                "table": table.name,
                "points": list(table.forward.shape),
                "from": [float(n[0]) * unit_of_position(a)[1] for a, n in _axes(table)],
                "to": [float(n[-1]) * unit_of_position(a)[1] for a, n in _axes(table)],
                "position_unit": ["deg" if is_rotary(a) else "mm" for a in table.inputs],
                "directions": 2 if table.directional else 1,
                "largest": table.largest() * factor,
                "unit": unit,
            }
        )
    return found


def _axes(table: Table) -> list[tuple[str, Any]]:
    return list(zip(table.inputs, table.nodes, strict=True))


def remainder_record(remainder: Remainder) -> dict[str, Any]:
    """The error that remains with the tables, µm."""
    return {
        "unit": "um",
        "rms": remainder.rms * 1e3,
        "p95": remainder.p95 * 1e3,
        "max": remainder.largest * 1e3,
        "shift": [float(s) * 1e3 for s in remainder.shift],
        "worst": {
            axis: position * unit_of_position(axis)[1] for axis, position in remainder.worst.items()
        },
        **_lean(remainder),
    }


def _lean(remainder: Remainder) -> dict[str, Any]:
    """By how much the tool is tilted."""
    return {
        "lean": {
            "unit": "urad", "rms": remainder.lean_rms * 1e6, "max": remainder.lean_largest * 1e6
        }
    }  # fmt: skip


def full_record(
    *,
    model: Mapping[str, Any],
    conditions: Mapping[str, Any],
    tables: Sequence[Mapping[str, Any]],
    remaining: Mapping[str, Mapping[str, Any]],
    made: str,
    by: str,
    abbe: str,
    notes: Sequence[str],
    sign: str,
    trust: Mapping[str, str],
    superposed: Mapping[str, str] | None = None,
    uncertainty: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The whole record that goes with tables (ISO/TR 16907, 9.1).

    Parameters
    ----------
    model, conditions, tables
        As the functions above give them.
    remaining
        What is left: without compensation, with these tables, with a full one.
    made, by, abbe
        When (ISO 8601), by whom, with which version of Abbe.
    notes
        Remarks of the user and of the projection.
    sign
        What the numbers in the files mean.
    trust
        How sure Abbe is of syntax, sign and activation.
    superposed
        Files of the tables that these were added to → SHA-256.
    uncertainty
        How sure the model is over the volume; None where nobody knows.
    """
    return {
        "made": made,
        "by": by,
        "abbe": abbe,
        "model": dict(model),
        "conditions": dict(conditions),
        "active_while_measured": dict(superposed) if superposed else {},
        "tables": list(tables),
        "sign": sign,
        "trust": dict(trust),
        "remaining": {name: dict(value) for name, value in remaining.items()},
        "uncertainty": None if uncertainty is None else dict(uncertainty),
        "notes": list(notes),
    }
