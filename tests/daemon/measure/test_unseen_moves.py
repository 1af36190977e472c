"""A move that a busy computer did not look at leaves no direction, and no row."""

import math

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.visits import SetupVisits
from abbe.daemon.config.sections.measure import InstrumentSection, MeasureSection
from abbe.daemon.measure.following.target_watch import TargetLeft, TargetRead, TargetWatch
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.unseen_moves import UnseenMoves
from abbe.daemon.pipeline.reading.directions import Directions

PERIOD = 0.02


def looks(pairs, deadbands=(0.01,)):
    """For each look (s, mm), whether the axis came unseen."""
    moves = UnseenMoves(deadbands)
    return [moves.step(time, [x])[0] for time, x in pairs]


def steady(begin, end, x, way=0.0, period=PERIOD):
    count = round((end - begin) / period)
    return [(begin + k * period, x + way * k / count) for k in range(count)]


def test_a_move_between_late_looks_is_unseen_until_the_next_that_is_seen():
    found = looks([*steady(0, 1, 0.0), (2.5, -0.1), *steady(2.52, 3, -0.1)])
    assert not any(found[:50])
    assert all(found[50:])
    found = looks([*steady(0, 1, 0.0), (2.5, -0.1), *steady(2.52, 3, -0.1, way=5.0)])
    assert found[50]
    assert not found[-1]


def test_who_stood_while_nobody_looked_has_its_direction():
    assert not any(looks([*steady(0, 1, 0.0), (3.0, 0.005), *steady(3.02, 4, 0.0)]))


def test_a_slow_instrument_makes_no_look_late():
    assert not any(looks(steady(0, 20, 0.0, way=100.0, period=0.4)))


def test_a_look_without_positions_is_none():
    found = looks([*steady(0, 1, 0.0), *[(t, math.nan) for t, _ in steady(1, 3, 0.0)], (3.0, 9.0)])
    assert found[-1]
    assert not any(found[:-1])


class Laser:
    """Reads the target itself, without error."""

    problem, angle, time, values = "", False, 0.0, ()
    unsure, scatter, interruptions = 1e-3, 0.0, 0
    section = InstrumentSection(source="a.b", reads="length")

    def sd(self, setup, target):
        return self.unsure

    def deviations(self, setup, positions):
        self.scatter = -self.scatter
        return (self.scatter,)


class Tracker(Laser):
    """Unsure by 10 µm, scatters by 6."""

    unsure, scatter = 1e-2, 6e-3


class Trembling(Laser):
    """Unsure by 1 µm, scatters by 6."""

    scatter = 6e-3


def followed(path, laser=None):
    """What a watch makes of a machine whose positions are looked at: outcomes, in order.

    A line of two targets, 0 and 100 mm, both ways; 100 is met upwards, then downwards from beyond.
    """
    places = np.array([0.0, 100.0])
    setup = PlannedSetup(
        INSTRUMENTS["laser"], "", "X", {"X": places},
        np.broadcast_to([1.0, 0.0, 0.0], (2, 1, 3)), Kind.DISPLACEMENT, ("zero",),
        np.full(2, 1e-3), name="s",
    )  # fmt: skip
    visits = SetupVisits(setup, 0.1, 1e-3)
    watch = TargetWatch(MeasureSection(settle=0.1, average=0.2, still_for=0.2), ["X"])
    directions, moves, laser = Directions([0.01]), UnseenMoves([0.01]), laser or Laser()
    outcomes = []
    for time, x in path:
        laser.time = time
        came, unseen = directions.step([x])[0], moves.step(time, [x])[0]
        seen = SeenMachine(
            time, {"X": x}, {"X": 0.0 if unseen else came}, "", {}, frozenset("X" * unseen)
        )
        outcome = watch.step(seen, laser, visits)
        if isinstance(outcome, TargetRead):
            visits.take(outcome.visit)
        if outcome is not None:
            outcomes.append(outcome)
    return outcomes


UP = [*steady(0, 1, 0.0), *steady(1, 2, 0.0, way=99.95), *steady(2, 3, 99.95)]
"""To the second target, met upwards (0.05 mm short of it), and a stop there."""


def test_beyond_and_back_seen_is_the_other_visit():
    beyond = [*steady(3, 3.2, 99.95, way=2.05), *steady(3.2, 3.4, 102.0, way=-1.98)]
    outcomes = followed([*UP, *beyond, *steady(3.4, 5, 100.02)])
    assert [o.visit for o in outcomes if isinstance(o, TargetRead)] == [0, 1, 2]


def test_beyond_and_back_unseen_is_not_read():
    # it stands 0.07 mm further up than before, and came from above
    outcomes = followed([*UP, *steady(4.2, 6, 100.02)])
    assert [o.visit for o in outcomes if isinstance(o, TargetRead)] == [0, 1]
    [left] = [o for o in outcomes if isinstance(o, TargetLeft)]
    assert "too busy to see from which side" in left.why


def test_readings_may_scatter_as_far_as_their_instrument_is_unsure():
    """A laser tracker's are no less steady for scattering by more than a laser's."""
    read = [o.visit for o in followed(UP, Tracker()) if isinstance(o, TargetRead)]
    assert read == [o.visit for o in followed(UP) if isinstance(o, TargetRead)]
    assert not any(isinstance(o, TargetRead) for o in followed(UP, Trembling()))
