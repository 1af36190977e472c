"""A check plan: lines that were not measured when the model was fitted, to verify the machine.

First one line along every axis, rotary ones by their angle, then the body diagonals, each where the
fitted lines are farthest, then ball bar, R-test, sphere, plate where they were not fitted;
what time is left goes to those set-ups that would tell most of what may have changed since.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.overlap import SAME_TARGET, overlap
from abbe.compcore.errors import InputError
from abbe.compcore.linalg import threads_for
from abbe.compcore.planning.check_placings import (
    PLACED,
    apart_by_name,
    nowhere_else,
    one_of_each,
    placings,
)
from abbe.compcore.planning.choice import Candidates, Chosen, Knowledge, choose
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.knowledge import CHANGED, VolumeError, added, prior
from abbe.compcore.planning.plan import SurveyPlan, campaign_of, ordered
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.gauges import probed_gauges
from abbe.compcore.planning.setups.lines import axis_lines, diagonals
from abbe.compcore.planning.setups.points import gauge_blocks
from abbe.compcore.planning.setups.rotations import turns
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.sentences import said

F64 = NDArray[np.float64]

_PARTS = (0.3, 0.7, 0.15, 0.85)
_PLACES = tuple((one, other) for one in _PARTS for other in _PARTS)
"""Where the other two axes stand: beside the middle and the corners where lines are fitted."""
_WITHIN = (0.03, 0.05)
"""Parts of its travel at the ends of which the only line of a machine is shorter when it checks:
it lies where the fitted one lies, and none of its targets does."""
_NEAR = 0.05
"""Part of the travels within which a line lies where a fitted one does."""
_ALONG = 1.0 - 1e-3
"""Cosine from which two lines are read along the same direction: a gauge lies as well as it can."""
_STILL = 0.05
"""Part of what the axis goes that goes farthest, both of their travels, up to which another stands.

A controller's positions are never twice the same, and a gauge lies somewhat aside and leans.
"""
_LONG = ("laser", "step-gauge")
_GAUGES = ("step-gauge", "gauge-block")
_TURN = "rotary-calibrator"
CHECKED_BY = ("laser", "step-gauge", "gauge-block", _TURN, *PLACED)
"""Instruments of check plans."""
RUNS = 5
"""Each way, as ISO 230-2 asks."""


def plan_check(
    task: SurveyTask,
    instruments: Sequence[PlannedInstrument],
    seconds: float,
    fitted: Campaign | None = None,
    *,
    runs: int = RUNS,
    changed: float = CHANGED,
) -> SurveyPlan:
    """Choose lines to verify a machine by, none of which the model was fitted to.

    Parameters
    ----------
    task
        The fitted model, and where the machine may go.
    instruments
        Those at hand; lines are measured by laser, step gauge, gauge blocks, rotary calibrator.
        What ball bar, R-test, sphere or plate show is judged by its range.
    seconds
        The time there is.
    fitted
        The campaigns of the fit; None: not at hand.
    runs
        Each way of each line.
    changed
        Part of its believable size by which a fitted parameter may have changed since.

    Raises
    ------
    InputError
        When no line of these instruments is left, or none fits into the time.
    """
    with threads_for(1):
        lines = _FittedLines(task, fitted)
        possible = (
            replace(s, runs=runs)
            for s in _lines(task, instruments)
            if (s.axis or not task.along_axes) and task.space.hindrance(task.machine, s) is None
        )
        pool = lines.new(list(possible))
        if not pool:
            raise InputError(
                "nothing that was not fitted can be measured by these",
                field="instruments",
                found=", ".join(i.key for i in instruments),
                expected="some of " + ", ".join(CHECKED_BY),
            )
        if (shortest := min(s.seconds for s in pool)) > seconds:
            raise InputError(
                "nothing that was not fitted can be measured in this time",
                field="time",
                found=f"{seconds / 60.0:.0f} min",
                expected=said(
                    "{minutes} min or more, or fewer runs (--runs)",
                    minutes=f"{shortest / 60.0:.0f}",
                ),
            )
        first: list[PlannedSetup] = []
        for setup in _coverage(task, pool, lines):
            if setup.seconds + sum(s.seconds for s in first) <= seconds:
                first.append(setup)
        start = Knowledge.beforehand(prior(task.model, changed), VolumeError.of(task))
        rest = [s for s in pool if not any(s is one for one in first)]
        found = choose(
            Candidates(rest, [added(task, s) for s in rest], (runs,)),
            start,
            seconds,
            required=[Chosen(s, added(task, s)) for s in first],
        )
        return apart_by_name(ordered(task, found, start), every=nowhere_else(task))


def _lines(task: SurveyTask, instruments: Sequence[PlannedInstrument]) -> Iterator[PlannedSetup]:
    """Lines and lengths; with other steps than those of usual plans, so that targets are new."""
    for instrument in instruments:
        if task.gauge is not None and instrument.key in _GAUGES:
            yield from probed_gauges(task, instrument, task.gauge)
            continue
        if instrument.key in _LONG:
            for axis in task.machine.structure.linear:
                count = task.count(axis) + 2
                own = axis_lines(task, instrument, _PLACES, count, _ends_free(task))
                yield from (s for s in own if s.axis == axis)
        if instrument.key == "laser":
            most = max((task.count(a) for a in task.machine.structure.linear), default=5)
            yield from diagonals(task, instrument, count=most + 2)
        elif instrument.key == "gauge-block":
            yield from gauge_blocks(task, instrument)
        elif instrument.key == _TURN:
            yield from turns(task, instrument, more=2)
        else:
            yield from placings(task, instrument)


def _ends_free(task: SurveyTask) -> tuple[float, float]:
    """Parts of the travel that check lines leave free at its ends."""
    return _WITHIN if nowhere_else(task) else (0.0, 0.0)


class _FittedLines:
    """What the fitted campaigns measured, as lines and as points."""

    def __init__(self, task: SurveyTask, fitted: Campaign | None) -> None:
        self._task = task
        self._fitted = fitted
        self._lines: list[tuple[F64, Mapping[str, bool], F64]] = []
        setup = None if fitted is None else fitted.conditions.setup
        if fitted is None or setup is None:
            return
        for name in fitted.setups:
            rows = fitted.rows(setup == name)
            u = rows.conditions.u
            if u is None or (rows.kind != Kind.DISPLACEMENT).any() or np.ptp(u, axis=0).any():
                continue
            at = {a: rows.conditions.position(a) for a in task.machine.axes}
            self._lines.append((u[0], _moves(task, at), _ends(task, at)))

    def new(self, setups: Sequence[PlannedSetup]) -> list[PlannedSetup]:
        """Those that are neither a fitted line nor at fitted points."""
        if self._fitted is None or not setups:
            return list(setups)
        named = [replace(s, name=f"candidate_{i}") for i, s in enumerate(setups)]
        planned = campaign_of(self._task, named)
        again = set(overlap(self._fitted, planned, SAME_TARGET).setups)
        return [
            s
            for s, one in zip(setups, named, strict=True)
            if one.name not in again and self.distance(s) >= _NEAR
        ]

    def distance(self, setup: PlannedSetup) -> float:
        """How far a line lies from the nearest fitted one, part of the travels; 1: from none."""
        u, moves = setup.u[0, 0], _moves(self._task, setup.targets)
        ends = _ends(self._task, {a: setup.targets[a] for a in self._task.machine.axes})
        alone = sum(moves.values()) == 1
        still = np.array([not moves[a] for a in self._task.machine.axes])
        nearest = 1.0
        for seen, moved, other in self._lines:
            if abs(float(seen @ u)) > _ALONG and moved == moves:
                # along its own axis a line lies where it lies, however far it goes
                apart = np.abs(ends - other)[:, still] if alone else np.abs(ends - other)
                if alone and nowhere_else(self._task):
                    continue
                nearest = min(nearest, float(apart.max(initial=0.0)))
        return nearest


def _moves(task: SurveyTask, at: Mapping[str, F64]) -> dict[str, bool]:
    """Which axes a line moves."""
    ways = np.ptp(_ends(task, at), axis=0)
    far = ways > _STILL * ways.max()
    return dict(zip(task.machine.axes, far.tolist(), strict=True))


def _ends(task: SurveyTask, at: Mapping[str, F64]) -> F64:
    """Where a line begins and ends, (2, axes), parts of the travels."""
    columns = [
        np.array([at[name].min(), at[name].max()]) / (2.0 * axis.half_travel)
        for name, axis in task.machine.axes.items()
    ]
    return np.stack(columns, axis=1)


def _coverage(
    task: SurveyTask, pool: Sequence[PlannedSetup], lines: _FittedLines
) -> Iterator[PlannedSetup]:
    """One line along each axis, farthest from what was fitted; then the body diagonals."""
    for axis in (*task.machine.structure.linear, *task.machine.structure.rotary):
        own = [s for s in pool if s.axis == axis and s.instrument.key in (*_LONG, _TURN)]
        if own:
            yield max(own, key=lines.distance)
    yield from (s for s in pool if s.what.startswith("body diagonal"))
    yield from one_of_each(pool)
