"""``abbe correct --points``: a file of points to a file with corrected columns, in pieces."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
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
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.streamed_conditions import LagStates, StreamedConditions
from abbe.compcore.model.inverse import invert_model
from abbe.compcore.model.measured_ranges import (
    OutsideMeasured,
    farthest,
    outside,
    outside_names,
)
from abbe.compcore.model.model import Model
from abbe.compcore.model.pose import command_of
from abbe.compcore.model.required_inputs import RequiredInputs
from abbe.compcore.model.sensitivity import covariance_root
from abbe.compcore.model.uncertainty import COVERAGE, UNKNOWN, uncertainty
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
    outside
        Positions, signals and tools that were not measured, each where it is farthest out.
    widest
        Greatest ± of a single axis, k = 2, mm; None where it was not asked for or nobody knows.
    """

    rows: int = 0
    worst: float = 0.0
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    outside: list[OutsideMeasured] = field(default_factory=list)
    widest: float | None = None
    warnings: list[str] = field(default_factory=list)

    def add(self, model: Model, at: Conditions, correction: F64) -> None:
        """Take some rows into account."""
        self.rows += len(correction)
        self.worst = max(self.worst, float(np.abs(correction).max(initial=0.0)))
        self.outside = farthest((*self.outside, *outside(model, at)))
        for axis, q in at.positions.items():
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
        if self.widest is not None:
            reported["uncertainty"] = {"largest": self.widest * 1e3, "k": COVERAGE}
        return reported | ({"warnings": self.warnings} if self.warnings else {})

    def as_text(self, out: Path) -> str:
        """One line for people."""
        wide = "" if self.widest is None else f" (± {self.widest * 1e3:.2f} at most)"
        return f"{self.rows} points, greatest correction {self.worst * 1e3:.2f} µm{wide}: {out}"


def correct_file(
    model: Model,
    path: Path,
    out: Path,
    given: Given,
    *,
    command: bool,
    held: Collection[str] = (),
    sure: bool = False,
    tell: Callable[[str], None],
) -> CorrectedFile:
    """Correct every point of a file; the output appears whole or not at all.

    `given` stands for columns that the file lacks; a command does not move rotary axes in `held`.
    With `sure` each row has its ± (k = 2) and what of it was not measured.

    Raises
    ------
    InputError
        Where ± is asked for and the model has none; for bad rows (file, line, column) and for what
        the model needs and neither file nor command line has.
    NotContractionError
        When a command cannot be found; names the line.
    """
    if sure and model.covariance is None:
        raise InputError(UNKNOWN, field="--uncertainty", expected="a model that abbe fit wrote")
    summary = CorrectedFile()
    required = RequiredInputs.of(model)
    with PointsFile(path, model.machine, tuple(model.machine.signals)) as source:
        reader = _RowReader(model, required, source, given)
        write_atomically(out, _lines(model, source, reader, summary, command, held, sure, tell))
    far = [f"{b}: nobody has seen what it does there" for b in summary.outside]
    summary.warnings = beyond(model, summary.ranges) + far + unfitted(model)
    return summary


def _lines(
    model: Model,
    source: PointsFile,
    reader: _RowReader,
    summary: CorrectedFile,
    command: bool,
    held: Collection[str],
    sure: bool,
    tell: Callable[[str], None],
) -> Iterator[str]:
    root = covariance_root(model.covariance) if sure and model.covariance is not None else None
    turned = model.machine.structure.rotary if command else ()
    carrying = model.machine.structure.carrying
    few = len(carrying) < len("XYZ")
    added = [f"{a}_corrected" for a in (*carrying, *turned)]
    added += ["place_left_um"] if few else []
    added += ["orientation_left_urad"] if turned else []
    added += [*(f"plus_minus_{a}_um" for a in "XYZ"), "not_measured"] if sure else []
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
        try:
            linear, further = _answers(model, at, command, held)
        except NotContractionError as error:
            lines = f"lines {block.line[0]} to {block.line[-1]}"
            raise NotContractionError(f"{source.file}, {lines}: {error}") from None
        surely = None if root is None else _how_sure(model, at.aside(), root, summary)
        reader.settle()
        summary.add(model, at, linear - _linear(at, carrying))
        tell(f"correcting: {summary.rows:,} rows")
        more = [""] * len(block.text)
        for column, digits in further:
            more = [m + f",{v:.{digits}f}" for m, v in zip(more, column.tolist(), strict=True)]
        if surely is not None:
            more = [m + s for m, s in zip(more, surely, strict=True)]
        yield "".join(
            text + "".join(f",{q:.7f}" for q in row) + f"{rest}\n"
            for text, row, rest in zip(block.text, linear.tolist(), more, strict=True)
        )
    if not summary.rows:
        raise InputError("no points", file=source.file, expected="a row below the header")


def _answers(
    model: Model, at: Conditions, command: bool, held: Collection[str]
) -> tuple[F64, list[tuple[F64, int]]]:
    """Corrected X, Y, Z, as far as they are there, (n, k), mm; further columns, and their digits.

    Further: rotary axes of a command, degrees; what of the place is left, µm, where one of X, Y, Z
    is missing; what a command leaves of the tool's direction, µrad.
    """
    machine = model.machine
    carrying, few = machine.structure.carrying, len(machine.structure.carrying) < len("XYZ")
    if command and machine.structure.rotary:
        posed = command_of(model, at, held=held)
        place = posed.conditions
        further = [(np.degrees(place.position(a)), 9) for a in machine.structure.rotary]
        further += [(posed.place_left * 1e3, 3)] if few else []
        return _linear(place, carrying), [*further, (posed.direction_left * 1e6, 3)]
    answer = _linear(at, carrying)
    if command:
        at, solved = invert_model(model, at)
        answer = solved.positions
    else:
        moved = model.axis_error(at)
        for k, a in enumerate(carrying):
            answer[:, k] += moved[a]
    if not few:
        return answer, []
    left = Chain(machine, at).left_by_moves(model.predict(at).translation)
    return answer, [(np.linalg.norm(left, axis=1) * 1e3, 3)]


def _linear(at: Conditions, carrying: Sequence[str]) -> F64:
    """Positions of these axes, (n, k), mm."""
    return np.stack([np.zeros(at.n), *(at.position(a) for a in carrying)], axis=1)[:, 1:]


def _how_sure(model: Model, at: Conditions, root: F64, summary: CorrectedFile) -> list[str]:
    """Each row's further cells: ± in X, Y, Z and what was not measured."""
    found = uncertainty(model, at, root)
    if found is None:
        return [",,,,"] * at.n
    wide = COVERAGE * found.translation
    summary.widest = max(summary.widest or 0.0, float(wide.max()))
    return [
        "".join(f",{v:.3f}" for v in row) + f",{names}"
        for row, names in zip((wide * 1e3).tolist(), outside_names(model, at), strict=True)
    ]


class _RowReader:
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
            raise columns.missing("time", "the model follows a signal slowly")

    def conditions(self, block: PointBlock) -> StreamedConditions:
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
