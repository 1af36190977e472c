"""Rotary axes from an R-test or ball bar: where their lines lie, how they err while they turn.

The tool's point follows a point of the table while a rotary axis turns (ISO 10791-6); what it
misses is read along X, Y, Z (R-test) or along one direction (ball bar). All readings of all
spheres are fitted together by the lines' places and leans (effect ``rotary_location``), with the
place of every sphere unknown; what is left at each angle is the axis's error motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.effects import RotaryLocation, SpindleLocation
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.design.unknowns import UnknownLayout
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.iso10791.error_motions import AngleCurve, MotionColumns, measured_directions
from abbe.compcore.iso10791.only_together import OnlyTogether, only_together
from abbe.compcore.iso10791.poses import around
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.as_built import AverageLine, Side, average_lines, side_of
from abbe.compcore.model.held_spindle import HeldSpindle, held_spindle, tool_of, where_they_are
from abbe.compcore.model.model import Model, Value

F64 = NDArray[np.float64]

_TURNED = 1e-4
"""rad that a rotary axis must have turned to be tested."""
_SAME_ANGLE = 1e-5
_ALONG = 0.98
_RANK = 1e-3
"""Singular values below this part of the largest belong to what the spheres do not separate."""
_IMITATED = 1e-6
"""Singular values below this part of the largest: what lines and places could as well explain."""
_FEWEST = 3


@dataclass(frozen=True, slots=True)
class ReadingRange:
    """The range of a test's readings in one direction, before evaluation.

    Attributes
    ----------
    axis, setup, direction
        The rotary axis that turned; the set-up; ``radial``, ``tangential`` or ``axial``.
    low, high
        Least and greatest error of the tool relative to the workpiece, mm.
    """

    axis: str
    setup: str
    direction: str
    low: float
    high: float

    @property
    def range(self) -> float:
        """Greatest less least, mm."""
        return self.high - self.low


@dataclass(frozen=True, eq=False)
class RotaryAxisResult:
    """The results of one rotary axis by ISO 10791-6.

    Attributes
    ----------
    axis, side
        The axis, and on which side of the bed it is.
    location
        ``E_X0C`` … → value ± standard uncertainty: errors of the tool relative to the workpiece.
    line
        The same as it is on the machine, and what to enter.
    ranges
        What was read, by set-up and direction.
    motions
        Error motions over the angle.
    """

    axis: str
    side: Side
    location: dict[str, Value]
    line: AverageLine
    ranges: tuple[ReadingRange, ...]
    motions: tuple[AngleCurve, ...]


@dataclass(frozen=True, eq=False)
class RotaryEvaluation:
    """The results of an R-test or ball bar test of rotary axes (ISO 10791-6).

    Attributes
    ----------
    axes
        In the order of the structure.
    result
        The fit of the lines.
    spindle
        Where the head holds its spindle; None where no axis of a head turned.
    together
        Which unknowns of a head the poses show only together.
    left
        Root mean square of what lines and error motions leave, mm.
    """

    axes: tuple[RotaryAxisResult, ...]
    result: FitResult
    spindle: HeldSpindle | None
    together: tuple[OnlyTogether, ...]
    left: float


def evaluate_rotary(machine: Machine, campaign: Campaign) -> RotaryEvaluation:
    """Evaluate the displacements of a campaign in which rotary axes turned.

    Raises
    ------
    InputError
        When no rotary axis of the machine turned, or nothing but displacements is wanted.
    """
    turned = [
        a for a in machine.structure.rotary if np.ptp(campaign.conditions.position(a)) > _TURNED
    ]
    if not turned:
        raise InputError(
            "no rotary axis turned",
            found=str(machine.structure),
            expected="readings at several angles of a rotary axis",
        )
    if (campaign.kind != Kind.DISPLACEMENT).any():
        raise InputError(
            "not readings of an R-test or ball bar",
            field="kind",
            found="rows of other kinds",
            expected="displacements only",
        )
    if any(side_of(machine, a) == "workpiece" for a in turned):
        # what a table carries is where its line has carried it, however well it was placed
        free = {n: replace(s, free=("frame",)) for n, s in campaign.setups.items()}
        campaign = replace(campaign, setups=free)
    loose = any("frame" in s.free for s in campaign.setups.values())
    held = [SpindleLocation()] if any(side_of(machine, a) == "tool" for a in turned) else []
    model = Model(machine).with_effects(*(RotaryLocation(axis=a) for a in turned), *held)
    curves, result = _separated(campaign, fit(model, campaign), turned)
    model = where_they_are(result.model, placed=not loose)
    lines = {line.axis: line for line in average_lines(model)}
    found = tuple(
        RotaryAxisResult(
            axis,
            side_of(machine, axis),
            dict(term.values),
            lines[axis],
            tuple(_ranges(machine, campaign, axis)),
            curves[axis],
        )
        for axis, term in zip(turned, model.terms, strict=False)
    )
    spindle = held_spindle(model, tool_of(campaign))
    together = only_together(result, _counted_from(result.problem.model, result.problem.layout))
    return RotaryEvaluation(
        found, result, spindle, tuple(together) if held else (), result.rms(Kind.DISPLACEMENT)
    )


def _separated(
    campaign: Campaign, result: FitResult, axes: Sequence[str]
) -> tuple[dict[str, tuple[AngleCurve, ...]], FitResult]:
    """Error motions of all axes, and the lines fitted without them.

    Motions at all angles are fitted together with the lines and the spheres' places. What these
    could as well explain is theirs: a motion has no constant part (the line is the average line,
    ISO 230-7), and none that turns with the table (the sphere lies elsewhere).
    """
    chain = Chain(result.problem.model.machine, campaign.conditions)
    found = {axis: MotionColumns.of(campaign, chain, axis) for axis in axes}
    columns = np.hstack([f.columns for f in found.values()])
    if not columns.shape[1]:
        return dict.fromkeys(axes, ()), replace(result, model=_with_zeros_kept(result))
    own = result.residualise(columns * result.problem.weight[:, None])
    amount, _, rank, _ = np.linalg.lstsq(own, result.weighted, rcond=_IMITATED)
    parts = np.split(amount, np.cumsum([f.columns.shape[1] for f in found.values()])[:-1])
    curves = {a: f.curves(a, p) for (a, f), p in zip(found.items(), parts, strict=True)}
    without = replace(campaign, value=campaign.value - columns @ amount)
    again = fit(result.problem.model, without)
    # readings that the motions took are no evidence of how well the lines are known
    wider = again.dof / max(again.dof - int(rank), 1)
    return curves, replace(again, model=_with_zeros_kept(again, wider))


def _with_zeros_kept(result: FitResult, factor: float = 1.0) -> Model:
    """The lines in the convention of this test: axes stand at 0 where they show 0.

    Where a sphere is placed anyhow, the readings do not show where an axis stands when it shows 0,
    nor where a head's line lies beside a sphere on the bed: what is not shown is 0, as far as
    it can be, and the rest least. Variances are multiplied by `factor`; what changes errors and
    was not measured (a lean, with one ball at the line's own height) keeps its plausible range.
    """
    layout, theta = result.problem.layout, result.theta
    scale, covariance = layout.scale, result.model.covariance
    if covariance is None:
        return result.model
    null = np.hstack([result.null.convention, result.null.unknown])
    move = np.eye(layout.size)
    for rows in _counted_from(result.problem.model, layout):
        kept = null[rows]
        if not null.shape[1] or not rows:
            continue
        step = np.eye(layout.size)
        step[:, rows] -= null @ np.linalg.pinv(kept, rcond=_IMITATED)
        move = step @ move
        _, size, right = np.linalg.svd(kept)
        null = null @ right[int((size > _IMITATED).sum()) :].T
    move = (np.eye(layout.size) - null @ np.linalg.pinv(null)) @ move
    move = scale[:, None] * move / scale
    covariance = factor * (move @ covariance @ move.T) + result.null.prior_covariance(scale)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    moved = result.model.with_values(layout.values(move @ theta, sd))
    return replace(moved, covariance=covariance)


def _counted_from(model: Model, layout: UnknownLayout) -> tuple[list[int], list[int]]:
    """The unknowns that say where axes count from: rotary ones' zeros, then a head's place."""
    zeros, places = [], []
    for where, effect in zip(layout.terms, model.effects, strict=True):
        if not isinstance(effect, RotaryLocation):
            continue
        zeros.append(where.stop - 1)
        for i, p in enumerate(effect.linear(model.machine)):
            if p.convention and p.unit == "mm":
                places.append(where.start + i)
    return zeros, places


def _ranges(machine: Machine, campaign: Campaign, axis: str) -> Iterator[ReadingRange]:
    """Radial, tangential and axial readings of the set-ups in which this axis alone turned."""
    setup = campaign.conditions.setup
    for name in campaign.setups if setup is not None else ():
        rows = np.flatnonzero(setup == name)
        part = campaign.rows(rows)
        moving = [
            a for a in machine.structure.rotary if np.ptp(part.conditions.position(a)) > _TURNED
        ]
        if moving != [axis]:
            continue
        at, error, known = _errors(part, axis)
        unit = around(Chain(machine, part.conditions.rows(at)), axis)
        for direction, u in zip(("radial", "tangential", "axial"), unit, strict=True):
            seen = known @ u[:, :, None]
            # a direction counts where the readings of a pose hold it
            whole = np.linalg.norm(seen[:, :, 0] - u, axis=1) < 1.0 - _ALONG
            whole &= np.linalg.norm(u, axis=1) > 0.5
            if whole.sum() < _FEWEST:
                continue
            value = np.einsum("ni,ni->n", error, u)[whole]
            yield ReadingRange(axis, name, direction, float(value.min()), float(value.max()))


def _errors(campaign: Campaign, axis: str) -> tuple[NDArray[np.int64], F64, F64]:
    """One row of each pose, the error seen there (m, 3), and the projection onto what is seen.

    The last has shape (m, 3, 3). Rows of one pose stand at one place; repeats are averaged.
    """
    c = campaign.conditions
    keys = [np.rint(q / _SAME_ANGLE).astype(np.int64) for q in c.positions.values()]
    if axis in c.directions:
        keys.append(c.directions[axis].astype(np.int64))
    _, first, number = np.unique(
        np.stack(keys, axis=1), axis=0, return_index=True, return_inverse=True
    )
    number = number.reshape(-1)
    errors, known = np.zeros((len(first), 3)), np.zeros((len(first), 3, 3))
    for i in range(len(first)):
        rows = number == i
        u = measured_directions(c)[rows]
        back = np.linalg.pinv(u, rcond=_RANK)
        errors[i], known[i] = back @ campaign.value[rows], back @ u
    return first, errors, known
