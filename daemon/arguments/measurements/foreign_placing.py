"""The placing of a foreign file's instrument, from the options of ``import-campaign``."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

import typer

from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.machine.plausible import TRAVEL, TRAVEL_ROTARY, signal_range
from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.arguments.assignments import number, split_assignments, tool_offset


def foreign_placing(
    at: str,
    tool: str,
    setup: str,
    sd: float | None,
    signals: Sequence[str],
    sign: int,
    *,
    rotation: bool,
) -> ForeignPlacing:
    """The placing of a measurement from the texts of its options.

    Parameters
    ----------
    at
        Where the other axes stood: ``Y=450,Z=-180``, mm (rotary: degrees).
    tool
        Offset of tool or probe, ``x,y,z`` in mm.
    setup
        Name of the set-up; empty: the file's.
    sd
        Standard uncertainty of a reading, µm or µrad.
    signals
        ``NAME=VALUE``, the same throughout.
    sign
        −1 where the file's sign is opposite to the one assumed.
    rotation
        Whether angles were measured.

    Raises
    ------
    InputError
        For what cannot be read, or believed.
    """
    if sign not in (1, -1):
        raise typer.BadParameter("1 or -1", param_hint="--sign")
    positions = {}
    for name, text in split_assignments(at.split(",") if at else []).items():
        if not name or name[0] not in "XYZUVWRABC":
            raise InputError("not the name of an axis", field="at", found=name)
        rotary = is_rotary(name)
        allowed = TRAVEL_ROTARY if rotary else TRAVEL
        value = number(name, text, "degrees" if rotary else "mm", allowed)
        positions[name] = radians(value) if is_rotary(name) else value
    recorded = {
        n: number(n, v, "its unit", signal_range(None))
        for n, v in split_assignments(signals).items()
    }
    uncertainty = None if sd is None else sd * (1e-6 if rotation else 1e-3)
    return ForeignPlacing(positions, tool_offset("tool", tool), setup, uncertainty, recorded, sign)
