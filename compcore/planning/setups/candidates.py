"""All set-ups that can be done on a machine with the instruments at hand."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups import gauges, lines, plates, points, poses, rotations
from abbe.compcore.planning.targets import SurveyTask

_OWN = {
    *("positioning", "backlash", "cyclic", "scale_expansion", "screw_heating"),
    "rotary_positioning",
}
"""Effects by which an axis errs along itself, wherever the others stand."""


def possible(task: SurveyTask, instruments: Sequence[PlannedInstrument]) -> Sequence[PlannedSetup]:
    """Set-ups within travels and outside keep-out boxes, one run each."""
    return unhindered(task, thought_of(task, instruments))


def unhindered(task: SurveyTask, thought: Iterable[PlannedSetup]) -> Sequence[PlannedSetup]:
    """Those of some set-ups that travels and keep-out boxes allow.

    Of a model that knows only how axes err along themselves those in which one axis moves, where
    there are such: what squareness and angles do along a diagonal it would call positioning.
    """
    found = [setup for setup in thought if task.space.hindrance(task.machine, setup) is None]
    alone = [setup for setup in found if setup.axis]
    if task.along_axes:
        return alone
    kinds = {effect.kind for effect in task.model.effects}
    return alone if alone and kinds and kinds <= _OWN else found


def thought_of(
    task: SurveyTask, instruments: Sequence[PlannedInstrument]
) -> Iterator[PlannedSetup]:
    """Set-ups whether or not a keep-out box hinders them, one run each."""
    for instrument in instruments:
        yield from _of(task, instrument)


def _of(task: SurveyTask, instrument: PlannedInstrument) -> Iterator[PlannedSetup]:
    key = instrument.key
    if key in ("gauge-block", "step-gauge") and task.gauge is not None:
        yield from gauges.probed_gauges(task, instrument, task.gauge)
        return
    if key in ("laser", "straightness", "angle", "level", "indicator", "step-gauge"):
        yield from lines.axis_lines(task, instrument)
    if key == "laser":
        yield from lines.diagonals(task, instrument)
    elif key == "ball-bar":
        yield from points.ball_bars(task, instrument)
    elif key in ("tracker", "laser-tracker"):
        yield from points.distances(task, instrument)
        yield from poses.poses(task, instrument)
    elif key == "ball-plate" and task.plate is not None:
        yield from plates.probed_plates(task, instrument, task.plate)
    elif key == "ball-plate":
        yield from points.ball_plates(task, instrument)
    elif key == "gauge-block":
        yield from points.gauge_blocks(task, instrument)
    elif key in ("r-test", "sphere"):
        yield from rotations.spheres(task, instrument)
    elif key == "rotary-calibrator":
        yield from rotations.turns(task, instrument)
