"""A compensation map as a campaign: the measurements that the map would have come from.

At every row of every table an ideal instrument reads the functional point's error along X, Y, Z and
the rotation about X, Y, Z that the map, applied by Abbe's conventions, predicts there; the other
axes stand at zero, where the levers of a map's angles are counted from. A fit of these rows gives
the map back in whatever shapes a model has.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.files.importers.placing import (
    COMPONENTS,
    ForeignPlacing,
    Readings,
    place,
    read_bytes,
)
from abbe.compcore.files.map_file import load_map
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention
from abbe.compcore.maps.to_model import import_map


def import_map_rows(
    path: str | Path,
    structure: Structure,
    placing: ForeignPlacing | None = None,
    convention: Convention | None = None,
) -> Campaign:
    """Read a compensation map as measured rows.

    Set-ups are named ``X E_YX`` and so on; nothing is left free, since a map holds constants
    (squareness) that a free zero would take away.

    Parameters
    ----------
    structure
        The machine's structure, linear axes only: which axis carries which.
    placing
        Its tool offset (mm) is part of the levers.
    convention
        How the map is meant where its maker's conventions are not Abbe's.

    Raises
    ------
    InputError
        For a bad map, or one that does not fit the structure.
    """
    source = Path(path)
    placing = placing or ForeignPlacing()
    compensation = load_map(source)
    model = import_map(compensation, structure, convention)
    readings = []
    for axis, table in compensation.tables.items():
        position = np.array(table.positions)
        n = len(position)
        at = {a: placing.at.get(a, 0.0) for a in structure.axes}
        conditions = Conditions.at({**at, axis: position}, tool=placing.tool)
        error = model.predict(conditions)
        for i, component in enumerate(COMPONENTS):
            values = error.rotation[:, i - 3] if i >= 3 else error.translation[:, i]
            u = np.zeros((n, 3))
            u[:, i % 3] = 1.0
            readings.append(
                Readings(
                    positions={axis: position},
                    directions={axis: np.zeros(n, dtype=np.int64)},
                    kind=Kind.ROTATION if i >= 3 else Kind.DISPLACEMENT,
                    value=values,
                    u=u,
                    free=(),
                    line=np.full(n, table.line or 0),
                    suffix=f" {axis} E_{component}{axis}",
                )
            )
    sign = "−1 × " if placing.sign < 0 else ""
    notes = [
        f"simulated from the compensation map {source.name}",
        f"sign: error = {sign}the map's values, read as errors (actual − indicated), right-handed",
        "tables are interpolated; the other axes stand at zero",
    ]
    return place(source, read_bytes(source), readings, placing, notes, {"instrument": "none"})
