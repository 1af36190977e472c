"""Readings that are never steady: another unit is told by where they move, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.daemon.config.sections.measure import InstrumentSection
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import MeasureEvent
from abbe.daemon.measure.following.average import SteadyReading
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.zero import InstrumentZero
from abbe.daemon.measure.news import MeasureNews
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import line_plan, write_plan

PLACES = (50.0, 150.0, 250.0, 350.0)


class Line:
    """A laser along X: what it reads at targets, and what is said of it."""

    def __init__(self, folder: Path) -> None:
        plan = write_plan(folder / "plan.toml", line_plan("x", "X", PLACES))
        self.course = MeasureCourse(read_plan(plan, load_model(MODEL).machine).setups, 0.1, 0.1)
        self.said: list[MeasureEvent] = []
        self.instrument = Instrument(
            "laser", InstrumentSection(source="cnc.laser", reads="length"), "mm"
        )
        news = MeasureNews(self.course, self.said.append, plan, {}, 60.0)
        self.zero = InstrumentZero(self.course, news)

    def rests(self, x: float, read: float) -> None:
        self.zero.rested((read - x,), (x,))

    def unsteady(self, visit: int, read: float, scatter: float) -> None:
        x = PLACES[visit]
        found = SteadyReading((read - x,), (scatter,), (0.0,), 10, (x, 450.0, -180.0))
        self.zero.look(self.instrument, found, (x,), visit)

    def steady(self, visit: int, read: float) -> list[float] | None:
        x = PLACES[visit]
        return self.zero.less(self.instrument, (read - x,), (x,), visit, 10.0 * visit)

    @property
    def parts(self) -> int:
        return self.course.parts[self.course.current]

    @property
    def doubts(self) -> list[str]:
        return [e.text for e in self.said if e.kind == "doubt"]


@pytest.fixture
def line(tmp_path: Path) -> Line:
    return Line(tmp_path)


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1000.0, "µm that are taken for mm"), (25.4, "mm that are taken for inches")],
)
def test_each_target_after_the_first_is_doubted_once(line: Line, factor: float, words: str) -> None:
    for visit in range(3):
        for _ in range(2):
            line.unsteady(visit, factor * PLACES[visit] + 7.0, 1e-4 * factor)
    assert len(line.doubts) == 2
    assert all(words in text and "not kept" in text for text in line.doubts)
    # by chance one is steady: it is no row
    assert line.steady(3, factor * PLACES[3] + 7.0) is None
    assert len(line.doubts) == 3


def test_after_a_steady_zero(line: Line) -> None:
    assert line.steady(0, 25.4 * PLACES[0]) == [0.0]
    line.unsteady(1, 25.4 * PLACES[1], 2.6e-3)
    assert "inches" in line.doubts[0]
    # set right: another zero begins
    assert line.steady(2, PLACES[2] - 3.0) == [0.0]
    assert line.steady(3, PLACES[3] - 3.0 + 0.002) == [pytest.approx(0.002)]
    assert len(line.doubts) == 1


def vibrates(line: Line) -> None:
    for visit, shift in ((0, 0.0), (1, 0.3), (2, -0.2)):
        line.unsteady(visit, PLACES[visit] + shift, 0.2)


def was_reset_between(line: Line) -> None:
    line.unsteady(0, 0.0, 0.01)
    line.zero.interrupted(counts=False)
    line.unsteady(1, 0.0, 0.01)


def shakes_as_far_as_it_moves(line: Line) -> None:
    line.unsteady(0, 1000.0 * PLACES[0], 30_000.0)
    line.unsteady(1, 1000.0 * PLACES[1], 30_000.0)


def has_followed_before(line: Line) -> None:
    assert line.steady(0, PLACES[0]) == [0.0]
    assert line.steady(1, PLACES[1]) == [0.0]
    line.unsteady(2, PLACES[1], 0.01)


@pytest.mark.parametrize(
    "happens", [vibrates, was_reset_between, shakes_as_far_as_it_moves, has_followed_before]
)
def test_nothing_is_said_of_what_only(happens: Callable[[Line], None], line: Line) -> None:
    happens(line)
    assert line.doubts == []


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1000.0, 'reads µm that are taken for mm: say unit = "um" of its channel cnc.laser'),
        (1.0 / 25.4, "inches that are taken for mm: set it to mm"),
        (0.001, 'm that are taken for mm: say unit = "m"'),
        (-1.0, "the sign is turned"),
    ],
)
def test_the_way_to_the_first_target_tells(line: Line, factor: float, words: str) -> None:
    """The program stands 2 mm beyond the first target before it comes to it."""
    line.rests(PLACES[0] - 2.0, factor * (PLACES[0] - 2.0) + 7.0)
    if factor > 1.0:
        line.unsteady(0, factor * PLACES[0] + 7.0, 1e-4 * factor)
    else:
        assert line.steady(0, factor * PLACES[0] + 7.0) is None
    assert words in line.doubts[0]


def test_the_way_to_the_first_target_tells_nothing_false(line: Line) -> None:
    line.rests(PLACES[0] - 2.0, PLACES[0] - 2.0 + 0.005)
    assert line.steady(0, PLACES[0]) == [0.0]
    # reset where it stood then, and at the target
    line.zero.forget()
    line.rests(PLACES[0] - 2.0, 0.0)
    assert line.steady(0, 0.0) == [0.0]
    # the beam was lost on the way
    line.zero.forget()
    line.rests(PLACES[0] - 2.0, 2.0)
    line.zero.interrupted(counts=False)
    assert line.steady(0, 0.0) == [0.0]
    assert line.doubts == []


def test_errors_that_jump_from_target_to_target_are_no_line_of_parts(line: Line) -> None:
    """µm that are taken for mm: only the first is kept, and what is wrong is said at once."""
    section = InstrumentSection(source="cnc.dial", reads="error")
    dial = Instrument("dial", section, "mm")
    for visit, read in enumerate((0.1, 7.9, 3.2, 5.5)):
        kept = line.zero.less(dial, (read,), (0.0,), visit, 10.0 * visit)
        assert (kept is not None) is (visit == 0)
    assert len(line.doubts) == 3
    assert "(mm, channel cnc.dial)" in line.doubts[0]
    assert "raise jump" in line.doubts[0]
    # set right it goes on, apart from what was kept before
    line.zero.less(dial, (5.5e-3,), (0.0,), 4, 40.0)
    assert line.zero.less(dial, (5.6e-3,), (0.0,), 5, 50.0) == [pytest.approx(5.6e-3)]
    assert line.parts == 2


def test_errors_that_are_too_small_are_said(line: Line) -> None:
    dial = Instrument("dial", InstrumentSection(source="cnc.dial", reads="error", sd=0.5), "um")
    for visit, read in enumerate((8e-6, 6e-6, 11e-6, 9e-6)):
        line.zero.less(dial, (read,), (0.0,), visit, 10.0 * visit)
    said = [e.text for e in line.said if e.kind == "note"]
    assert len(said) == 1
    assert "(um, channel cnc.dial)" in said[0]
