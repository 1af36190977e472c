"""Encoders: wrap-around followed across the edge, never guessed; write-back that fits."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from abbe.drivers.link import Quality, Sample
from abbe.drivers.transducers import (
    TRANSDUCER_CONFIG,
    Encoder,
    SensorFaultError,
    TransducerFault,
    make_transducer,
)


def make(**config: Any) -> Encoder:
    encoder = make_transducer(
        TRANSDUCER_CONFIG.validate_python({"type": "encoder", "counts_per_mm": 1000} | config)
    )
    assert isinstance(encoder, Encoder)
    return encoder


def wrapped(count: int, bits: int, signed: bool) -> int:
    """What a counter of that width shows."""
    count %= 1 << bits
    return count - (1 << bits) if signed and count >= 1 << (bits - 1) else count


@given(
    st.sampled_from([16, 32]),
    st.booleans(),
    st.sampled_from([1, -1]),
    st.integers(-(2**20), 2**20),
    st.lists(st.integers(-16384, 16384), min_size=1, max_size=60),
)
def test_a_wrapping_counter_is_followed_across_its_edge(
    bits: int, signed: bool, direction: int, zero: int, steps: list[int]
) -> None:
    encoder = make(bits=bits, signed=signed, direction=direction, zero=zero)
    start = 2 ** (bits - 1) - 100  # near the edge of a signed counter
    count = wrapped(start, bits, signed)
    assert encoder.value(count) == pytest.approx(direction * (count - zero) / 1000)
    for step in steps:
        count += step
        sample = encoder.convert(Sample(wrapped(count, bits, signed), 0.0))
        assert sample.value == pytest.approx(direction * (count - zero) / 1000, abs=1e-9)


@given(st.floats(0, 700), st.integers(-(2**31), 2**31 - 1), st.sampled_from([1, -1]))
def test_the_travel_tells_the_turn_from_any_zero(
    position: float, zero: int, direction: int
) -> None:
    encoder = make(counts_per_mm=10000, direction=direction, zero=zero, travel=[0, 700])
    count = round(zero + direction * position * 10000)
    # Stateless: neither earlier samples nor gaps matter.
    encoder.convert(Sample(wrapped(zero, 32, True), 0.0))
    sample = encoder.convert(Sample(wrapped(count, 32, True), 1e6))
    assert sample.good, sample.reason
    assert sample.value == pytest.approx(position, abs=0.5e-4 + 1e-9)


def test_beyond_the_travel_is_out_of_range() -> None:
    encoder = make(travel=[-360, 0])
    assert encoder.value(10_000) == pytest.approx(10.0)  # a little beyond: limit switches
    sample = encoder.convert(Sample(50_000, 0.0))
    assert sample.reason == "out of range: 50.0000 mm, outside the travel -360 to 0 mm"


def test_a_jump_is_not_guessed_and_stays_bad_until_referenced() -> None:
    encoder = make(bits=16)
    assert encoder.convert(Sample(100, 0.0)).good
    jump = encoder.convert(Sample(20_000, 0.01))
    assert jump.quality is Quality.BAD
    assert jump.reason.startswith("count jump: the count jumped by +19900, more than 0.25 of the ")
    after = encoder.convert(Sample(20_001, 0.02))
    assert after.reason.startswith("not referenced: the count jumped by +19900")
    assert math.isnan(after.value)
    assert not encoder.referenced
    encoder.reference(position=151.0)
    # 20001 counts is 20.001 mm plus whole turns of 65.536 mm: two of them lie nearest to 151 mm.
    assert encoder.convert(Sample(20_001, 0.03)).value == pytest.approx(20.001 + 2 * 65.536)
    assert encoder.referenced


def test_a_long_pause_is_not_guessed() -> None:
    encoder = make(bits=16, max_gap=0.5)
    assert encoder.convert(Sample(100, 10.0)).good
    assert encoder.convert(Sample(200, 10.5)).good
    bad = Sample(math.nan, 10.8, Quality.UNAVAILABLE, "time-out")
    assert encoder.convert(bad) is bad
    late = encoder.convert(Sample(300, 11.1))
    assert late.reason.startswith("not referenced: no count for 0.6 s, longer than 0.5 s")
    assert not encoder.convert(Sample(300, 11.2)).good
    encoder.reference()
    assert encoder.convert(Sample(300, 20.0)).value == pytest.approx(0.3)


def test_the_gap_follows_from_the_speed() -> None:
    encoder = make(bits=16, max_speed=500.0)  # a quarter of 65.536 mm takes 33 ms
    assert encoder.convert(Sample(0, 0.0)).good
    assert encoder.convert(Sample(10_000, 0.032)).good
    assert not encoder.convert(Sample(10_000, 0.066)).good
    with pytest.raises(ValidationError, match=r"passes max_jump = 0\.25 of its range in 0\.0328 s"):
        make(bits=16, max_speed=500.0, max_gap=0.1)


def test_a_rotary_axis_is_in_radians() -> None:
    encoder = make_transducer(
        TRANSDUCER_CONFIG.validate_python({"type": "encoder", "counts_per_rev": 3600, "zero": 900})
    )
    assert encoder.unit == "rad"
    assert encoder.value(1800) == pytest.approx(math.pi / 2)
    assert encoder.inverse(math.pi) == 2700


@pytest.mark.parametrize(
    ("bits", "signed", "position", "count"),
    [(32, True, 1.00004, 1000), (32, True, 1.00051, 1001), (32, True, -1.00051, -1001)],
)
def test_write_back_rounds_to_the_nearest_count(
    bits: int, signed: bool, position: float, count: int
) -> None:
    assert make(bits=bits, signed=signed).inverse(position) == count


@pytest.mark.parametrize(
    ("config", "last", "beyond"),
    [
        ({"bits": 16}, 32.767, 32.768),
        ({"bits": 16, "signed": False}, 65.535, -0.001),
        ({"bits": 32, "counts_per_mm": 100_000}, 21474.83647, 21474.83648),
    ],
)
def test_write_back_never_overflows(config: dict[str, Any], last: float, beyond: float) -> None:
    encoder = make(**config)
    encoder.inverse(last)
    with pytest.raises(SensorFaultError, match="outside") as caught:
        encoder.inverse(beyond)
    assert caught.value.fault is TransducerFault.OUT_OF_RANGE


@pytest.mark.parametrize(
    ("config", "raw", "said"),
    [
        ({}, 0.5, "not a whole count"),
        ({"bits": 16}, 65536, "does not fit 16 bits"),
        ({"bits": 16}, -32769, "does not fit 16 bits"),
        ({"bits": 64}, 2.0**53 + 2, "beyond 2^53"),
        ({}, math.nan, "not a number"),
    ],
)
def test_numbers_that_are_no_counts_are_named(
    config: dict[str, Any], raw: float, said: str
) -> None:
    sample = make(**config).convert(Sample(raw, 0.0))
    assert sample.quality is Quality.BAD
    assert said in sample.reason


def test_64_bit_counters_do_not_wrap() -> None:
    encoder = make(bits=64, counts_per_mm=1e6)
    assert encoder.value(9.0e15) == 9.0e9
    assert encoder.value(-9.0e15) == -9.0e9


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"counts_per_rev": 100}, "exactly one"),
        ({"counts_per_mm": None}, "exactly one"),
        ({"travel": [5, 5]}, "must rise"),
        ({"direction": 0}, "direction"),
        ({"bits": 24}, "bits"),
        ({"counts": 24}, "counts"),
    ],
)
def test_configurations_that_cannot_work_are_refused(config: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        make(**config)
    assert said in str(caught.value)
