"""The feed with which the machine came, from looks at a course whose feed is known."""

import math

import numpy as np
import pytest

from abbe.daemon.config.sections.measure import MeasureSection
from abbe.daemon.measure.following.arrival_feed import ArrivalFeed
from abbe.daemon.measure.machine_view import SeenMachine

LIMITS = MeasureSection()
ACCELERATION = 500.0
"""mm/s²."""


def leg(begin, end, feed, stands=1.0):
    """A straight move that starts and stops, and a stand: s, position along it."""
    way, top = float(np.linalg.norm(np.subtract(end, begin))), feed / 60.0
    ramp = min(top / ACCELERATION, math.sqrt(way / ACCELERATION))
    lasts = 2.0 * ramp + max(0.0, way - ACCELERATION * ramp**2) / top

    def at(t):
        t = min(t, lasts)
        left = lasts - t
        first, last = (
            0.5 * ACCELERATION * min(t, ramp) ** 2,
            0.5 * ACCELERATION * min(left, ramp) ** 2,
        )
        gone = (
            first + max(0.0, min(t, lasts - ramp) - ramp) * top if t < lasts - ramp else way - last
        )
        return np.asarray(begin, float) + gone / way * np.subtract(end, begin)

    return lasts + stands, at


def feeds(axes, legs, *, late=(), period=0.02, seed=1):
    """What is told after each leg; looks come when a busy computer looks, encoders flicker."""
    rng = np.random.default_rng(seed)
    feed, told, start, clock = ArrivalFeed(LIMITS, axes), [], 0.0, 0.0
    for lasts, at in legs:
        while clock < start + lasts:
            if not any(a <= clock < b for a, b in late):
                place = at(clock - start) + 3e-4 * rng.standard_normal(len(axes))
                shown = {
                    a: math.radians(q) if a in "ABC" else q
                    for a, q in zip(axes, place, strict=True)
                }
                # the moment of the look is told some ms late
                feed.look(SeenMachine(clock + 2e-3 * rng.random(), shown, {}, "", {}))
            clock += period * (1.0 + 0.5 * rng.random())
        start += lasts
        told.append(feed.values())
    return told


@pytest.mark.parametrize("feed", [60.0, 1000.0, 6000.0])
def test_the_feed_of_the_last_move(feed):
    way = max(10.0, feed / 60.0)
    told = feeds("XY", [leg([0, 0], [way, 0], 0.5 * feed), leg([way, 0], [way, way], feed)])
    assert told[0]["feed"] == pytest.approx(0.5 * feed, rel=0.03)
    assert told[1]["feed"] == pytest.approx(feed, rel=0.03)
    assert "feed_turn" not in told[0]


def test_a_path_that_turns_without_a_stand_tells_its_last_leg():
    """Beyond the target at rapid, back at a feed: the way back counts."""
    told = feeds("X", [leg([0.0], [100.0], 6000.0, stands=0.0), leg([100.0], [80.0], 1200.0)])
    assert told[-1]["feed"] == pytest.approx(1200.0, rel=0.03)
    told = feeds("XY", [leg([0, 0], [50, 0], 3000.0, stands=0.0), leg([50, 0], [50, 50], 1500.0)])
    assert told[-1]["feed"] == pytest.approx(1500.0, rel=0.03)


def test_what_was_too_short_or_not_looked_at_is_not_told():
    assert feeds("X", [leg([0.0], [0.05], 3000.0)]) == [{"feed": None}]
    stood = leg([0.0], [1e-9], 1000.0, stands=2.0)
    assert feeds("X", [stood]) == [{"feed": None}]
    way = leg([0.0], [60.0], 3600.0)
    there = [stood, way]
    assert feeds("X", there)[-1]["feed"] == pytest.approx(3600.0, rel=0.03)
    # away while it moved, and back when it stands
    assert feeds("X", there, late=[(1.9, 3.4)])[-1] == {"feed": None}
    # away while it stood
    assert feeds("X", [stood, leg([0.0], [60.0], 3600.0, 5.0)], late=[(4.5, 6.0)])[-1][
        "feed"
    ] == pytest.approx(3600.0, rel=0.03)


def test_rotary_axes_have_a_feed_of_their_own_in_degrees():
    told = feeds("XC", [leg([0, 0], [100, 0], 2000.0), leg([100, 0], [100, 90], 1800.0)])
    assert told[0] == {"feed": pytest.approx(2000.0, rel=0.03), "feed_turn": None}
    assert told[1] == {
        "feed": told[0]["feed"],
        "feed_turn": pytest.approx(1800.0, rel=0.03),
    }


def test_a_look_without_positions_is_none():
    feed = ArrivalFeed(LIMITS, "X")
    for k in range(100):
        feed.look(SeenMachine(0.02 * k, {"X": math.nan}, {"X": 0.0}, "stale", {}))
    assert feed.values() == {"feed": None}
