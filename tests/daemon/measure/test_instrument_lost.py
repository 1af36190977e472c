"""What is lost while measuring: an instrument's zero, a thermometer; each guard by itself."""

from __future__ import annotations

import math

import pytest

from abbe.daemon.config.sections.measure import InstrumentSection
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.machine_view import SeenMachine, missing_signal
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.drivers.link import Quality, Sample

STALE = 2.0


def looked(answers: list[tuple[float, Sample, int]], section: InstrumentSection) -> Instrument:
    """An instrument after looks: time, what its channel said, how often its link came back."""
    laser = Instrument("laser", section, "mm")
    for now, sample, reconnects in answers:
        batch = {"laser": {"length": sample, "beam": Sample(1.0, now)}}
        laser.take(batch, now, reconnects)
    return laser


def good(now: float) -> Sample:
    return Sample(100.0, now)


def silent(now: float) -> Sample:
    return Sample(math.nan, now, Quality.UNAVAILABLE, "no answer")


PLAIN = InstrumentSection(source="laser.length", reads="length", stale_after=STALE)
BEAM = InstrumentSection(
    source="laser.length", beam="laser.beam", reads="length", stale_after=STALE
)


def test_silent_on_a_link_that_stays_it_may_have_been_switched_off() -> None:
    """A read-out behind a gateway: nothing reconnects, nothing says that a beam is lost."""
    answers = [(t, good(t), 0) for t in (0.0, 0.2)]
    answers += [(t, silent(t), 0) for t in (0.2 * i for i in range(2, 15))]
    assert looked([*answers, (3.0, good(3.0), 0)], PLAIN).interruptions == 1
    # for a moment only it is the same one
    short = [*answers[:7], (1.4, good(1.4), 0)]
    assert looked(short, PLAIN).interruptions == 0


def test_a_link_that_came_back_between_two_looks_has_lost_it() -> None:
    """Unplugged and plugged in again within less than a reading may be old."""
    answers = [(0.0, good(0.0), 0), (0.2, good(0.2), 0), (0.4, good(0.4), 1), (0.6, good(0.6), 1)]
    assert looked(answers, PLAIN).interruptions == 1


def test_an_answer_without_a_number_is_a_lost_beam() -> None:
    def empty(now: float) -> Sample:
        return Sample(math.nan, now, Quality.BAD, "no number")

    answers = [(0.0, good(0.0), 0), *((0.1 * i, empty(0.1 * i), 0) for i in range(1, 5))]
    assert looked(answers, PLAIN).interruptions == 1
    # a single garbled line is none
    assert looked([*answers[:2], (0.2, good(0.2), 0)], PLAIN).interruptions == 0


def test_a_beam_that_is_said_to_be_lost_is() -> None:
    laser = Instrument("laser", BEAM, "mm")
    for now, beam in ((0.0, 1.0), (0.1, 0.0), (0.2, 1.0)):
        batch = {"laser": {"length": good(now), "beam": Sample(beam, now)}}
        laser.take(batch, now, 0)
    assert laser.interruptions == 1


@pytest.mark.parametrize(
    ("reading", "missing"),
    [
        (SignalReading(20.0, "", 99.0), ""),
        # its last value counts for as long as it is held, and no longer
        (SignalReading(20.0, "open circuit", 99.0), ""),
        (SignalReading(20.0, "open circuit", 97.0), "T_x1: open circuit"),
        # what is read seldom is not lost
        (SignalReading(20.0, "", 90.0), ""),
        (SignalReading(), "T_x1: not read yet"),
        (SignalReading(fault="open circuit"), "T_x1: open circuit"),
    ],
)
def test_a_lost_thermometer_counts_for_as_long_as_it_is_held(
    reading: SignalReading, missing: str
) -> None:
    seen = SeenMachine(100.0, {}, {}, "", {"T_x1": reading})
    assert missing_signal(seen, 2.0) == missing
