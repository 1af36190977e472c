"""Delta Tau (Turbo) PMAC: leadscrew compensation tables, a script of on-line commands."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table
from abbe.drivers.controllers.axes import (
    axis_numbers,
    equidistant,
    moved_axis,
    output_of,
    position_unit,
)
from abbe.drivers.controllers.base import (
    Confidence,
    Controller,
    ControllerOptions,
    NumberPerAxis,
    PerAxis,
    Trust,
)
from abbe.drivers.controllers.text import above_zero, numbered_lines, only_file, whole

_FINE = 16
"""Entries are sixteenths of a count."""
_DEFINE = re.compile(
    r"DEFINE COMP (?P<entries>\d{1,9}),#(?P<source>\d{1,9})D?,#(?P<target>\d{1,9}),"
    r"(?P<span>\d{1,12})",
    re.IGNORECASE,
)
_MOTOR = re.compile(r"#(\d+)")
_A_LINE = 10
"""Entries a line."""


class PmacOptions(ControllerOptions):
    """Options of `Pmac`."""

    motors: PerAxis = Field(default_factory=dict)
    """Axis → motor; none: X 1, Y 2, Z 3, then as the structure lists them."""
    counts: NumberPerAxis = Field(default_factory=dict)
    """Axis → counts per mm (rotary: per degree); 1000 where not given."""
    owners: Annotated[int, Field(ge=1, le=32)] = 8
    """Motors that may own a table, 8 on PMAC and 32 on Turbo PMAC: also those of no axis."""
    points: Annotated[int, Field(ge=2, le=10_000)] = 1000
    """Most points of a table."""


class Pmac(Controller):
    """Tables of one motor's desired position that correct it or another, rolling over at their end.

    The correction at the motor's zero is zero by definition; entries count upwards from there in
    equal steps; those of positions below zero come last, where the span has rolled over.
    """

    name: ClassVar[str] = "pmac"
    title: ClassVar[str] = "Delta Tau PMAC and Turbo PMAC: DEFINE COMP"
    sign: ClassVar[str] = (
        "error (actual − indicated), sixteenths of a count: the correction that is added to the "
        "sensor's position"
    )
    source: ClassVar[str] = (
        "PMAC 2 Software Reference p. 207-211, Turbo PMAC Software Reference p. 302-303, PMAC User "
        "Manual p. 79-81; P reports the sensor's position plus the correction (PMAC User's Manual "
        "4.6)"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "no manual that was read shows an example with its sign; that a correction is added to the "
        "sensor's position is concluded from what P reports",
    )
    Options: ClassVar[type[ControllerOptions]] = PmacOptions
    options: PmacOptions

    @property
    def capability(self) -> Capability:
        """L-POS, L-STR and their rotary relatives: as many tables as there are motors."""
        axes = self.machine.structure.axes
        holds = [
            self._holds(source, moved)
            for source in axes
            for moved in axes
            if moved in ("X", "Y", "Z") or moved == source
        ]
        return Capability(tuple(holds), lookup="command", most_tables=self.options.owners)

    def _holds(self, source: str, moved: str) -> Holds:
        """Tables of one motor that correct another, or itself: whole counts along, 1/16 across."""
        own = source == moved
        fine = self._count(moved) / _FINE
        spacing = Spacing(
            "equidistant",
            least=0.1 * position_unit(source),
            unit=self._count(source),
            through_zero=True,
        )
        return Holds(
            "axis" if own else "cross",
            ("L-POS", "R-POS") if own else ("L-STR", "R-RAX"),
            points=self.options.points,
            spacing=spacing,
            rotary_spacing=spacing,
            resolution=fine,
            rotary_resolution=fine,
            zero_at="zero",
            inputs=(source,),
            outputs=(moved,),
        )

    def _count(self, axis: str) -> float:
        """A count of an axis's motor, mm or rad."""
        return position_unit(axis) / self.options.counts.get(axis, 1000.0)

    def _motors(self) -> dict[str, int]:
        return axis_numbers(self.machine, self.options.motors)

    def _owners(self, tables: Sequence[Table]) -> list[tuple[int, Table]]:
        """Which motor owns each table: an axis's own first, then motors that have none yet."""
        motors = self._motors()
        own: dict[int, Table] = {}
        waiting = []
        for table in tables:
            source = motors[table.inputs[0]]
            if self._target(table) == source and source not in own:
                own[source] = table
            else:
                waiting.append(table)
        free = [m for m in range(1, self.options.owners + 1) if m not in own]
        if len(waiting) > len(free):
            raise InputError(
                "more tables than motors that can own one", field="owners", found=len(tables),
                expected=f"at most {self.options.owners}",
            )  # fmt: skip
        own.update(zip(free, waiting, strict=False))
        return sorted(own.items(), key=lambda item: item[0])

    def _target(self, table: Table) -> int:
        return self._motors()[moved_axis(table)]

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        lines = ["I51=0"]
        for owner, table in reversed(self._owners(tables)):
            (axis,) = table.inputs
            count = self._count(axis)
            step = whole(float(table.nodes[0][1] - table.nodes[0][0]), count, table.name)
            index = np.rint(table.nodes[0] / (count * step)).astype(int)
            above, below = int(index[-1]), int(-index[0])
            fine = self._output_step(table)
            values = {
                int(i): whole(float(v), fine, table.name)
                for i, v in zip(index, table.forward, strict=True)
            }
            # one entry more, 0: the last is also that of zero, where the span rolls over
            entries = above + below + 1
            row = [values.get(k, values.get(k - entries, 0)) for k in range(1, entries + 1)]
            source, target = self._motors()[axis], self._target(table)
            lines += [f"#{owner}", f"DEFINE COMP {entries},#{source}D,#{target},{entries * step}"]
            lines += [
                " " + " ".join(str(v) for v in row[i : i + _A_LINE])
                for i in range(0, len(row), _A_LINE)
            ]
        return {"comp.pmc": "\n".join([*lines, "I51=1", "SAVE", ""])}

    def _output_step(self, table: Table) -> float:
        return self._count(moved_axis(table)) / _FINE

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        name, text = only_file(files)
        axes = {motor: axis for axis, motor in self._motors().items()}
        found: list[Table] = []
        heading: re.Match[str] | None = None
        values: list[int] = []

        def finish(line: int) -> None:
            if heading is None:
                return
            if len(values) != int(heading["entries"]):
                raise InputError(
                    "a table's entries are not complete",
                    file=name,
                    line=line,
                    found=len(values),
                    expected=f"{heading['entries']} entries",
                )
            found.append(self._table(heading, values, axes, name, line))

        for i, line in numbered_lines(text):
            if defined := _DEFINE.fullmatch(line):
                finish(i)
                heading, values = defined, []
            elif _MOTOR.fullmatch(line) or line.upper() in ("", "I51=0", "I51=1", "SAVE"):
                continue
            else:
                try:
                    values += [int(v) for v in line.split()]
                except ValueError:
                    raise InputError(
                        "not an entry or a command of a compensation table",
                        file=name,
                        line=i,
                        found=line,
                        expected="whole numbers, #n, DEFINE COMP …, I51=… or SAVE",
                    ) from None
        finish(text.count("\n"))
        return found

    def _table(
        self,
        heading: re.Match[str],
        values: Sequence[int],
        axes: Mapping[int, str],
        file: str,
        line: int,
    ) -> Table:
        source, target = int(heading["source"]), int(heading["target"])
        if source not in axes or target not in axes:
            raise InputError(
                "a motor that no axis belongs to", file=file, line=line,
                found=f"#{source}, #{target}", expected="motors of " + ", ".join(axes.values()),
            )  # fmt: skip
        axis, moved = axes[source], axes[target]
        count = len(values)
        span = above_zero(int(heading["span"]), file, line, "DEFINE COMP")
        step = span / above_zero(count, file, line, "entries") * self._count(axis)
        low, high = self.machine.axis(axis).travel
        below = 0 if low >= 0.0 else math.ceil(-low / step - 1e-6)
        above = count if not below and count * step <= high + 1e-6 else count - 1 - below
        entry = [0 if k == 0 else values[(k - 1) % count] for k in range(-below, above + 1)]
        nodes = equidistant(-below * step, step, below + above + 1)
        fine = self._count(moved) / _FINE
        return Table(output_of(moved), (axis,), (nodes,), np.array(entry) * fine)

    def activation(self) -> tuple[str, ...]:
        """On-line commands, home first."""
        return (
            "Machine position 0 of each axis must be its motor's zero: home before anything else.",
            "Delete old tables from the lowest motor to the highest: #n DELETE COMP.",
            "I6 must not hide errors: ERR003 means that a buffer (another COMP of a lower motor, "
            "TCOMP, "
            "BLCOMP, TBUF, ROTARY, LOOKAHEAD, GATHER) is in the way.",
            "Send comp.pmc; it switches the tables on (I51=1) and saves.",
            "Check one point with an indicator before cutting: the sign has not been tried.",
        )
