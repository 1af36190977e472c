"""``abbe correct --points``: a file of points to a file with corrected columns, in pieces."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError, NotContractionError
from abbe.compcore.files.campaign_csv.columns import TOOL
from abbe.compcore.files.points_file import PointBlock, PointsFile
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.streamed_conditions import LagStates, StreamedConditions
from abbe.compcore.model.inverse import invert_model
from abbe.compcore.model.model import Model
from abbe.compcore.model.pose import command_of
from abbe.compcore.model.required_inputs import RequiredInputs
from abbe.compcore.model.uncertainty import unmeasured
from abbe.daemon.arguments.point_arguments import Given, beyond, unfitted

F64 = NDArray[np.float64]


@dataclass
class CorrectedFile:
    """The result of correcting a file of points.

    Attributes
    ----------
    rows
        Number of points.
    worst
        Greatest correction of a single axis, mm.
    ranges
        Axis → least and greatest indicated position, mm (rotary: rad).
    """

    rows: int = 0
    worst: float = 0.0
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def add(self, positions: dict[str, F64], correction: F64) -> None:
        """Take some rows into account."""
        self.rows += len(correction)
        self.worst = max(self.worst, float(np.abs(correction).max()))
        for axis, q in positions.items():
            low, high = self.ranges.get(axis, (np.inf, -np.inf))
            self.ranges[axis] = (min(low, float(q.min())), max(high, float(q.max())))

    def as_json(self, out: Path) -> dict[str, Any]:
        """One object for ``--json``."""
        reported: dict[str, Any] = {
            "rows": self.rows,
            "out": str(out),
            "max_correction": self.worst * 1e3,
            "unit": "um",
        }
        return reported | ({"warnings": self.warnings} if self.warnings else {})


def correct_file(
    model: Model,
    path: Path,
    out: Path,
    given: Given,
    *,
    command: bool,
    held: Collection[str] = (),
    tell: Callable[[str], None],
) -> CorrectedFile:
    """Correct every point of a file; the output appears whole or not at all.

    `given` stands for columns that the file lacks; a command does not move rotary axes in `held`.

    Raises
    ------
    InputError
        For bad rows (file, line, column) and for what the model needs and neither file nor
        command line has.
    NotContractionError
        When a command cannot be found; names the line.
    """
    summary = CorrectedFile()
    required = RequiredInputs.of(model)
    with PointsFile(path, model.machine, tuple(model.machine.signals)) as source:
        reader = _Reader(model, required, source, given)
        write_atomically(out, _lines(model, source, reader, summary, command, held, tell))
    far = [f"{b}: nobody has seen what it does there" for b in unmeasured(model, summary.ranges)]
    summary.warnings = beyond(model, summary.ranges) + far + unfitted(model)
    return summary


def _lines(
    model: Model,
    source: PointsFile,
    reader: _Reader,
    summary: CorrectedFile,
    command: bool,
    held: Collection[str],
    tell: Callable[[str], None],
) -> Iterator[str]:
    turned = model.machine.structure.rotary if command else ()
    added = [f"{a}_corrected" for a in (*"XYZ", *turned)]
    added += ["orientation_left_urad"] if turned else []
    for name in added:
        if name in source.columns:
            raise InputError(
                "the file has corrected columns already",
                file=source.file,
                line=source.columns.line,
                field=name,
            )
    yield "".join(f"{line}\n" for line in source.top) + ",".join([source.header, *added]) + "\n"
    for block in source.blocks():
        at = reader.conditions(block)
        start = np.stack([at.position(a) for a in "XYZ"], axis=1)
        angles: list[F64] = []
        if command:
            try:
                if turned:
                    posed = command_of(model, at, held=held)
                    place = posed.conditions.position
                    answer = np.stack([place(a) for a in "XYZ"], axis=1)
                    angles = [np.degrees(place(a)) for a in turned]
                    angles.append(posed.direction_left * 1e6)
                else:
                    answer = invert_model(model, at)[1].positions
            except NotContractionError as error:
                lines = f"lines {block.line[0]} to {block.line[-1]}"
                raise NotContractionError(f"{source.file}, {lines}: {error}") from None
        else:
            moved = model.axis_error(at)
            answer = start + np.stack([moved[a] for a in "XYZ"], axis=1)
        reader.settle()
        summary.add(dict(at.positions), answer - start)
        tell(f"correcting: {summary.rows:,} rows")
        more = [""] * len(block.text)
        if angles:
            rows = np.stack(angles, axis=1).tolist()
            more = ["".join(f",{q:.9f}" for q in row[:-1]) + f",{row[-1]:.3f}" for row in rows]
        yield "".join(
            f"{text},{x:.7f},{y:.7f},{z:.7f}{rest}\n"
            for text, (x, y, z), rest in zip(block.text, answer.tolist(), more, strict=True)
        )
    if not summary.rows:
        raise InputError("no points", file=source.file, expected="a row below the header")


class _Reader:
    """Makes conditions of rows, with what the command line gives for columns that are missing."""

    def __init__(
        self, model: Model, required: RequiredInputs, source: PointsFile, given: Given
    ) -> None:
        machine, columns = model.machine, source.columns
        self._machine, self._file, self._given = machine, source.file, given
        self._columns = columns
        self._signals = [s for s in machine.signals if s in columns]
        self._lags = LagStates()
        self._in_order = bool(required.lagged)
        self._last = -np.inf
        self._pending = -np.inf
        for axis in machine.structure.axes:
            if axis not in columns.positions and axis not in given.positions:
                raise columns.missing_axis(axis)
        twice = [a for a in given.positions if a in columns.positions]
        twice += [s for s in given.signals if s in columns]
        twice += [f"{a}_dir" for a in given.directions if a in columns.directions]
        twice += ["tool"] if given.tool and any(t in columns for t in (*TOOL, "tool")) else []
        twice += ["time"] if given.time is not None and "time" in columns else []
        if twice:
            raise InputError(
                "given on the command line and in the file",
                file=source.file,
                line=columns.line,
                field=twice[0],
            )
        clock = "time" in columns or given.time is not None
        try:
            given.require(model, required, [*self._signals, *given.signals], clock=clock)
        except InputError as error:
            raise error.at(file=source.file, line=columns.line) from None
        if required.lagged and "time" not in columns:
            raise columns.missing("time", ": the model follows a signal slowly")

    def conditions(self, block: PointBlock) -> Conditions:
        """The rows in the units inside the code."""
        n, columns, given = len(block.text), self._columns, self._given

        def constant(value: float) -> F64:
            return np.full(n, value)

        positions = {}
        for axis in self._machine.structure.axes:
            if axis in columns.positions:
                q = block.columns[columns.positions[axis]]
                positions[axis] = np.deg2rad(q) if self._machine.axis(axis).rotary else q
            else:
                positions[axis] = constant(given.positions[axis])
        directions = {a: constant(v) for a, v in given.directions.items()}
        directions |= {a: block.columns[c] for a, c in columns.directions.items()}
        signals = {s: constant(v) for s, v in given.signals.items()}
        signals |= {s: block.columns[s] for s in self._signals}
        if any(t in block.columns for t in TOOL):
            zero = np.zeros(n)
            tool = np.stack([block.columns.get(t, zero) for t in TOOL], axis=1)
        else:
            tool = np.tile(np.asarray(given.tool or (0.0, 0.0, 0.0)), (n, 1))
        spindle = None
        if columns.spindle:
            spindle = np.deg2rad(block.columns[columns.spindle])
        elif given.spindle_angle is not None:
            spindle = constant(given.spindle_angle)
        time = block.columns.get("time", constant(given.time or 0.0))
        self._check_order(block, time)
        return StreamedConditions(
            positions=positions,
            directions=directions,
            tool=tool,
            time=time,
            signals=signals,
            spindle_angle=spindle,
            flow=self._lags,
        )

    def settle(self) -> None:
        """The rows are done with: lags go on from their last."""
        self._lags.settle()
        self._last = self._pending

    def _check_order(self, block: PointBlock, time: F64) -> None:
        """Lagged signals need their past: a piece must not reach back before the one before."""
        if not self._in_order:
            return
        early = time < self._last
        if early.any():
            row = int(early.argmax())
            raise InputError(
                "rows are not in the order of time, which the model's lags need",
                file=self._file,
                line=int(block.line[row]),
                field="time",
                found=f"{time[row]:g}",
                expected=f"at least {self._last:g} s",
            )
        self._pending = float(time.max())
