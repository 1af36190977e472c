"""Samples become positions and signals only when they are fresh, good and believable."""

from __future__ import annotations

import math

import pytest

from abbe.daemon.pipeline.reading.convert import (
    ChannelSource,
    PositionConverter,
    SignalConverter,
    Watch,
)
from abbe.daemon.pipeline.reading.poll import Batch, by_link
from abbe.drivers.link import Quality, Sample
from abbe.drivers.transducers import EncoderConfig, SteinhartHartConfig, make_transducer

ENCODER = make_transducer(EncoderConfig(counts_per_mm=1000.0, travel=(0.0, 500.0)))
THERMISTOR = make_transducer(SteinhartHartConfig(a=1.032e-3, b=2.387e-4, c=1.580e-7))
SOURCES = [ChannelSource("X", ("cmm", "x"), ENCODER), ChannelSource("Y", ("cmm", "y"))]


def batch(**values: float | Sample) -> Batch:
    return {
        "cmm": {
            k: v if isinstance(v, Sample) else Sample(float(v), 10.0) for k, v in values.items()
        }
    }


def bad(reason: str) -> Sample:
    return Sample(math.nan, 10.0, Quality.BAD, reason)


def test_fresh_and_good() -> None:
    positions, faults = PositionConverter(SOURCES, 0.2, Watch())(batch(x=250_000, y=7.5), 10.1)
    assert positions == [250.0, 7.5]
    assert faults == {}


@pytest.mark.parametrize(
    ("x", "now", "why"),
    [
        (bad("exception 4"), 10.0, "exception 4"),
        (250_000, 10.3, "stale: 0.3 s old"),
        (999_000_000, 10.0, "out of range: 999000.0000 mm"),
        (math.nan, 10.0, "not a number"),
        (Sample(math.nan, 10.0, Quality.UNAVAILABLE), 10.0, "unavailable"),
    ],
)
def test_what_is_not_to_be_believed_is_nan_and_named(
    x: float | Sample, now: float, why: str
) -> None:
    at = Sample(7.5, now)
    positions, faults = PositionConverter(SOURCES, 0.2, Watch())(batch(x=x, y=at), now)
    assert math.isnan(positions[0])
    assert positions[1] == 7.5
    assert list(faults) == ["X"]
    assert why in faults["X"]


def test_a_channel_that_was_not_read_is_no_position() -> None:
    positions, faults = PositionConverter(SOURCES, 0.2, Watch())({}, 10.0)
    assert all(map(math.isnan, positions))
    assert set(faults) == {"X", "Y"}


def test_a_heartbeat_that_stands_still_makes_positions_stale() -> None:
    watch = Watch(heartbeat=("cmm", "beat"), within=1.0)
    convert = PositionConverter(SOURCES, 0.2, watch)

    def faults(now: float, beat: float | Sample) -> dict[str, str]:
        at = {k: Sample(v, now) for k, v in (("x", 250_000.0), ("y", 1.0))}
        if not isinstance(beat, Sample):
            beat = Sample(beat, now)
        return convert(batch(**at, beat=beat), now)[1]

    assert faults(10.0, 5) == {}
    assert faults(10.9, 5) == {}
    assert set(faults(11.1, 5)) == {"X", "Y"}
    assert "stands still" in faults(11.2, 5)["X"]
    assert faults(11.3, 6) == {}
    assert "exception 2" in faults(11.4, bad("exception 2"))["Y"]


def test_the_controllers_status_word_is_obeyed() -> None:
    watch = Watch(status=("cmm", "word"), require=0b100, forbid=0b1000)
    convert = PositionConverter(SOURCES, 0.2, watch)

    def fault(word: int) -> str:
        positions, faults = convert(batch(x=1000, y=1.0, word=word), 10.0)
        assert all(map(math.isnan, positions)) == bool(faults)
        return faults.get("X", "")

    assert fault(0b101) == ""
    assert fault(0b001) == "the controller's status word lacks bit 2"
    assert fault(0b1100) == "the controller's status word has bit 3"


def test_signals_keep_their_last_good_value() -> None:
    convert = SignalConverter([ChannelSource("T", ("cmm", "r"), THERMISTOR)], stale_after=5.0)

    def reading(r: float | Sample, now: float) -> tuple[float, str]:
        found = convert(batch(r=r), now)["T"]
        return found.value, found.fault

    first = convert({}, 9.0)["T"]
    assert math.isnan(first.value)
    assert first.fault
    value, fault = reading(Sample(10_000.0, 10.0), 10.0)
    assert value == pytest.approx(25.0, abs=0.01)
    assert fault == ""
    cut = reading(Sample(4.0e8, 11.0), 11.0)
    assert cut[0] == value
    assert "broken wire" in cut[1]
    short = reading(Sample(0.0, 12.0), 12.0)
    assert short[0] == value
    assert "short circuit" in short[1]
    assert reading(Sample(10_000.0, 13.0), 13.0)[1] == ""


def test_a_device_that_is_silent_for_a_moment_is_no_fault_of_a_signal() -> None:
    convert = SignalConverter([ChannelSource("T", ("cmm", "r"))], stale_after=5.0)
    convert(batch(r=Sample(20.5, 10.0)), 10.0)
    silent = Sample(math.nan, 14.0, Quality.UNAVAILABLE, "no answer")
    assert convert(batch(r=silent), 14.0)["T"].fault == ""
    late = convert(batch(r=silent), 15.1)["T"]
    assert late.fault == "no answer"
    assert late.value == 20.5


def test_channels_are_read_once_by_link() -> None:
    wanted = [("a", "x"), ("b", "t"), ("a", "x"), ("a", "y")]
    assert by_link(wanted) == {"a": ("x", "y"), "b": ("t",)}


def test_the_second_drive_less_the_first_of_the_same_question() -> None:
    ahead = ChannelSource("Y_ahead", ("cmm", "y2"), minus=("cmm", "y"))
    assert ahead.take(batch(y=700.0, y2=700.031)).value == pytest.approx(0.031, abs=1e-12)
    moved = ahead.take(batch(y=700.0, y2=Sample(705.0, 10.02)))
    assert not moved.good  # the bridge moved on between the two questions
    assert moved.reason == "not of the same question as cmm:y"
    unread = ahead.take(batch(y=bad("exception 4"), y2=700.0))
    assert (unread.good, unread.reason) == (False, "exception 4")
    assert not ahead.take(batch(y2=700.0)).good
    readings = SignalConverter([ahead], 1.0)(batch(y=700.0, y2=700.031), 10.0)
    assert readings["Y_ahead"].value == pytest.approx(0.031, abs=1e-12)
