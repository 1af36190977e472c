"""R-tests and ball bars on rotary axes (ISO 10791-6) to a campaign.

CSV, a row a pose: rotary axes in degrees by their names, then either ``dX, dY, dZ`` (R-test: what a
nest of sensors shows of a sphere) or ``radial``, ``tangential``, ``axial`` (ball bar; any of them).
Where the sphere is on the workpiece stands at the top (``# sphere = 90, 40, 60``; several: ``#
sphere P1 = …`` and a column ``sphere``). Where X, Y, Z stood may be in columns; else they followed
the sphere as the controller computes it.
"""

from __future__ import annotations

from pathlib import Path

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.measuring_conditions import stated
from abbe.compcore.files.importers.placing import ForeignPlacing, place
from abbe.compcore.files.importers.rotary.rotary_test import (
    RotaryTest,
    RotaryTestOptions,
    spheres,
    words,
)
from abbe.compcore.files.importers.sheets.roles import RoleColumns
from abbe.compcore.files.importers.sheets.words import read_sheet
from abbe.compcore.machine.machine import Machine


def import_rtest(
    path: str | Path,
    machine: Machine,
    placing: ForeignPlacing | None = None,
    options: RotaryTestOptions | None = None,
) -> Campaign:
    """Read a test of rotary axes; one set-up a sphere, where the sphere really is left free.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    source = Path(path)
    placing, options = placing or ForeignPlacing(), options or RotaryTestOptions()
    sheet = read_sheet(source)
    columns = RoleColumns.of(sheet, words(machine))
    test = RotaryTest.of(columns, machine, placing, options)
    readings = [r for sphere, rows in spheres(columns).items() for r in test.read(sphere, rows)]
    notes = [
        f"imported from {source.name} (test of rotary axes, ISO 10791-6)",
        f"in {test.unit}",
        *test.notes(),
    ]
    metadata = {"instrument": "R-test", **stated(sheet.comments)}
    return place(source, sheet.data, readings, placing, notes, metadata, machine)
