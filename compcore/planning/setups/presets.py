"""Usual programmes of measurements, to be planned as they are or to be compared with a plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups import lines, points, rotations
from abbe.compcore.planning.targets import SurveyTask


@dataclass(frozen=True, slots=True)
class Preset:
    """A usual programme of measurements.

    Attributes
    ----------
    key, title
        Its name on the command line, and for people.
    setups
        Its set-ups on a machine, in their order.
    """

    key: str
    title: str
    setups: Callable[[SurveyTask], Iterator[PlannedSetup]]


def _iso230_2(task: SurveyTask) -> Iterator[PlannedSetup]:
    laser = INSTRUMENTS["laser"]
    for setup in lines.axis_lines(task, laser, lines.PARTS[:1]):
        yield replace(setup, runs=5)


def _iso230_6(task: SurveyTask) -> Iterator[PlannedSetup]:
    for setup in lines.diagonals(task, INSTRUMENTS["laser"], faces=False):
        yield replace(setup, runs=5)


def _iso10360_2(task: SurveyTask) -> Iterator[PlannedSetup]:
    """Five lengths, three times, in seven positions: 6 ends of a step gauge on each line."""
    gauge = replace(INSTRUMENTS["step-gauge"], reach=1e5)
    for setup in lines.axis_lines(task, gauge, lines.PARTS[:1], targets=6):
        yield replace(setup, runs=3)
    for setup in lines.diagonals(task, gauge, faces=False, count=6):
        yield replace(setup, runs=3)


def _krulewich(task: SurveyTask) -> Iterator[PlannedSetup]:
    """Distances from three bases, with every tool, to random positions."""
    for setup in points.distances(task, INSTRUMENTS["tracker"], seed=1995, count=100):
        if "corner 4" not in setup.what:
            yield setup


def _iso10791_6(task: SurveyTask) -> Iterator[PlannedSetup]:
    seen: set[str] = set()
    for setup in rotations.spheres(task, INSTRUMENTS["r-test"]):
        if setup.axis not in seen:
            seen.add(setup.axis)
            yield replace(setup, runs=2)


def _iso16907(task: SurveyTask) -> Iterator[PlannedSetup]:
    """The direct measurements of 10.3: angles, positioning, straightness, squareness, rotary."""
    for key, runs in (("angle", 2), ("level", 2), ("laser", 5), ("straightness", 2)):
        for setup in lines.axis_lines(task, INSTRUMENTS[key], lines.PARTS[:1]):
            words = setup.what.split(" ")
            if key != "level" or words[2] == words[4]:
                yield replace(setup, runs=runs)
    for setup in lines.diagonals(task, INSTRUMENTS["laser"]):
        if setup.what.startswith("face"):
            kept = setup.what.split(" at ")[1].split(" ")
            low = task.ends(kept[0])[0]
            if np.isclose(setup.targets[kept[0]][0], low, atol=1e-3):
                yield replace(setup, runs=2)
    yield from _iso10791_6(task)


PRESETS: Mapping[str, Preset] = {
    p.key: p
    for p in (
        Preset("iso230-2", "laser, positioning of each axis (ISO 230-2)", _iso230_2),
        Preset("iso230-6", "laser, body diagonals (ISO 230-6)", _iso230_6),
        Preset("iso10360-2", "step gauge, lengths in seven positions (ISO 10360-2)", _iso10360_2),
        Preset("krulewich", "tracker, distances from three bases (Krulewich)", _krulewich),
        Preset("iso10791-6", "R-test, rotary axes (ISO 10791-6)", _iso10791_6),
        Preset(
            "iso16907",
            "laser, levels and R-test, all direct measurements (ISO/TR 16907, 10.3)",
            _iso16907,
        ),
    )
}
"""Name on the command line → preset."""


def preset_called(name: str) -> Preset:
    """The preset of a name.

    Raises
    ------
    InputError
        When there is none; lists those that there are.
    """
    if name not in PRESETS:
        raise InputError(
            "no such preset", field="preset", found=name, expected="one of " + ", ".join(PRESETS)
        )
    return PRESETS[name]


def possible_of(preset: Preset, task: SurveyTask) -> list[PlannedSetup]:
    """The set-ups of a preset that travels and keep-out boxes allow."""
    return [s for s in preset.setups(task) if task.space.hindrance(task.machine, s) is None]


def filled(setups: Sequence[PlannedSetup], seconds: float) -> list[int]:
    """Which of the set-ups, in their order and again from the front, fill a time."""
    chosen: list[int] = []
    while True:
        before = len(chosen)
        for i, setup in enumerate(setups):
            if setup.seconds <= seconds:
                chosen.append(i)
                seconds -= setup.seconds
        if len(chosen) == before:
            return chosen
