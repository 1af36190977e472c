"""An instrument that is frozen is told from one that is coarse."""

from __future__ import annotations

import random

import pytest

from abbe.daemon.measure.following.liveliness import InstrumentLiveliness

STAY = 60
"""Readings at a target; as many on the way to the next."""


def readings(places: int, step: float, scatter: float, each: int = 1) -> list[tuple[float, bool]]:
    """What an instrument shows in steps of its display at places that differ, and on the way."""
    source, found = random.Random(5), []
    for place in range(places):
        for k in range(2 * STAY):
            at = 0.01 * (place + min(1.0, k / STAY))
            if k % each == 0:
                shown = round((at + source.gauss(0.0, scatter)) / step) * step
            found.append((shown, k >= STAY))
    return found


def told(shown: list[tuple[float, bool]]) -> list[int]:
    """At which readings it is told to be frozen."""
    lively, found = InstrumentLiveliness(), []
    for k, (value, stands) in enumerate(shown):
        lively.add(float(k), (value,), stands=stands)
        if lively.frozen:
            found.append(k)
    return found


@pytest.mark.parametrize(
    ("step", "scatter", "each"),
    [(1e-5, 1e-4, 1), (1e-4, 1e-4, 1), (1e-4, 1e-4, 12), (1e-3, 1e-4, 1), (1e-3, 4e-4, 1),
     (1e-2, 1e-4, 1), (1e-3, 1e-3, 5)],
)  # fmt: skip
def test_what_measures_is_never_told(step: float, scatter: float, each: int) -> None:
    assert told(readings(40, step, scatter, each)) == []


@pytest.mark.parametrize("on_the_way", [False, True])
def test_a_reading_that_stays_is_told_before_a_target_is_read(on_the_way: bool) -> None:
    shown = readings(6, 1e-5, 1e-4)
    begin = 2 * STAY * 4 + (STAY // 2 if on_the_way else STAY + 3)
    frozen = [*shown[:begin], *((shown[begin][0], s) for _, s in shown[begin:])]
    found = told(frozen)
    assert found == list(range(found[0], len(frozen)))
    assert begin + 15 < found[0] < begin + 40


def test_readings_taken_twice_are_one() -> None:
    lively = InstrumentLiveliness()
    for k, (value, stands) in enumerate(readings(3, 1e-5, 1e-4)):
        lively.add(float(k), (value,), stands=stands)
    for _ in range(1000):
        lively.add(float(k), (value,), stands=True)
    assert not lively.frozen
