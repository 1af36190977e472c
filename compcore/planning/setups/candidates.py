"""All set-ups that can be done on a machine with the instruments at hand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups import lines, points, rotations
from abbe.compcore.planning.targets import SurveyTask


def possible(task: SurveyTask, instruments: Sequence[PlannedInstrument]) -> Iterator[PlannedSetup]:
    """Set-ups within travels and outside keep-out boxes, one run each."""
    for instrument in instruments:
        for setup in _of(task, instrument):
            if task.space.hindrance(task.machine, setup) is None:
                yield setup


def _of(task: SurveyTask, instrument: PlannedInstrument) -> Iterator[PlannedSetup]:
    key = instrument.key
    if key in ("laser", "straightness", "angle", "level", "indicator", "step-gauge"):
        yield from lines.axis_lines(task, instrument)
    if key == "laser":
        yield from lines.diagonals(task, instrument)
    elif key == "ball-bar":
        yield from points.ball_bars(task, instrument)
    elif key in ("tracker", "laser-tracker"):
        yield from points.distances(task, instrument)
    elif key == "ball-plate":
        yield from points.ball_plates(task, instrument)
    elif key == "gauge-block":
        yield from points.gauge_blocks(task, instrument)
    elif key in ("r-test", "sphere"):
        yield from rotations.spheres(task, instrument)
