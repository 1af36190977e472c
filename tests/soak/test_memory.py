"""The judge of a soak's memory: a leak is seen, what comes and goes is none."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from abbe.drivers.simulated.soak.memory import SETTLED, Growth, MemoryCurve
from abbe.drivers.simulated.soak.supervisor import _own_memory


def life(curve: MemoryCurve, leak: float, seconds: int, seed: int = 1) -> None:
    """A life of a process that warms up, takes and gives back, and leaks so many MB an hour."""
    chance = np.random.default_rng(seed)
    curve.begin()
    taken = 0.0
    for second in range(seconds):
        taken += -taken / 120.0 + chance.normal(0.0, 0.02)
        warm_up = 20.0 * min(1.0, second / 500.0)
        curve.note(second, 60.0 + warm_up + taken + leak * second / 3600.0)


def growth(leak: float, *lives: int) -> Growth:
    curve = MemoryCurve()
    for number, seconds in enumerate(lives):
        life(curve, leak, seconds, number)
    found = curve.growth
    assert found is not None
    return found


@pytest.mark.parametrize("lives", [(2520,), (2000, 40, 2000, 2000)])
def test_a_leak_of_five_megabytes_an_hour_is_seen(lives: tuple[int, ...]) -> None:
    """In the time that an hour's soak leaves to one life, and in several shorter ones."""
    found = growth(5.0, *lives)
    assert found.shown
    assert found.slope == pytest.approx(5.0, abs=found.uncertainty)
    assert str(found).endswith("it grows by more than 2")


def test_what_comes_and_goes_is_no_leak() -> None:
    found = growth(0.0, 2520)
    assert not found.shown
    assert found.slope == pytest.approx(0.0, abs=found.uncertainty)
    assert str(found).endswith("it does not grow by more than 2")


@pytest.mark.thorough
def test_how_sure_it_is() -> None:
    """The stated interval holds what is true nineteen times in twenty, and no leak is passed."""
    found = [_one(seed, 5.0) for seed in range(60)]
    held = sum(abs(f.slope - 5.0) <= f.uncertainty for f in found)
    assert held >= 51
    assert not any(str(f).endswith("it does not grow by more than 2") for f in found)


@pytest.mark.thorough
@pytest.mark.parametrize(("lasting", "least"), [(1.0, 54), (60.0, 54), (300.0, 54), (1200.0, 50)])
def test_how_sure_it_is_however_long_what_is_taken_is_kept(lasting: float, least: int) -> None:
    """From what is given back at once to what wanders for as long as one looks."""
    held = 0
    for seed in range(60):
        chance = np.random.default_rng(seed)
        curve = MemoryCurve()
        curve.begin()
        taken = 0.0
        for second in range(0, 2520, 5):
            taken += -taken * min(1.0, 5.0 / lasting) + chance.normal(0.0, 0.05)
            curve.note(second, 60.0 + taken + second / 3600.0)
        found = curve.growth
        assert found is not None
        held += abs(found.slope - 1.0) <= found.uncertainty
        assert found.uncertainty < 30.0
    assert held >= least


def _one(seed: int, leak: float) -> Growth:
    curve = MemoryCurve()
    life(curve, leak, 2520, seed)
    found = curve.growth
    assert found is not None
    return found


def test_too_short_a_time_says_nothing() -> None:
    """As the 644 s of which a slope of 2.9 MB an hour was told once."""
    curve = MemoryCurve()
    assert curve.growth is None
    life(curve, 30.0, int(SETTLED) + 500)
    curve.note(SETTLED + 501.0, math.nan)
    assert curve.growth is None
    assert curve.longest[-1][0] == SETTLED + 499.0


_TAKES = """
import sys
taken = []
for line in sys.stdin:
    taken.append(bytearray(int(line)))
    for at in range(0, len(taken[-1]), 4096):
        taken[-1][at] = 1
    print(len(taken), flush=True)
"""


def test_what_a_process_takes_is_measured() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _TAKES], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    sizes = []
    for _ in range(3):
        process.stdin.write("5000000\n")
        process.stdin.flush()
        process.stdout.readline()
        sizes.append(_own_memory(process.pid))
    assert np.diff(sizes) == pytest.approx([5.0, 5.0], abs=0.5)
    process.communicate(timeout=60.0)
    assert math.isnan(_own_memory(process.pid))
