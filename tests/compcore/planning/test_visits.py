"""Visits of targets: which one is meant where a machine stands, whatever it leaves out."""

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.errors import InputError
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.visits import SetupVisits

PLACES = np.array([0.0, 50.0, 100.0, 150.0])


def setup(*, both_ways=True, runs=1, places=PLACES):
    n = len(places)
    return PlannedSetup(
        INSTRUMENTS["laser"], "", "X",
        {"X": places, "Y": np.full(n, 20.0), "C": np.zeros(n)},
        np.broadcast_to([1.0, 0.0, 0.0], (n, 1, 3)), Kind.DISPLACEMENT, ("zero",),
        np.full(n, 1e-3), runs=runs, both_ways=both_ways, name="s",
    )  # fmt: skip


def visits(**how):
    return SetupVisits(setup(**how), 0.1, 1e-3)


def at(found, x, sense, y=20.0, c=0.0):
    return found.at({"X": x, "Y": y, "C": c}, {"X": sense, "Y": 1.0, "C": 0.0})


def test_in_order_there_and_back():
    found = visits()
    for k, (x, sense) in enumerate([(x, 1.0) for x in PLACES] + [(x, -1.0) for x in PLACES[::-1]]):
        assert at(found, x + 0.05, sense) == k
        assert found.take(k) == []
    assert found.left == []
    assert found.expected == found.count == 8


@pytest.mark.parametrize(
    ("place", "meant"),
    [
        ((50.0, 1.0), 1),
        ((50.0, -1.0), 6),  # the same place on the way back
        ((50.0, 0.0), 1),  # where it came from is not known: the one that is expected
        ((50.11, 1.0), None),  # too far off
        ((25.0, 1.0), None),
    ],
)
def test_place_and_side_tell_the_visit(place, meant):
    found = visits()
    found.take(0)
    assert at(found, *place) == meant


@pytest.mark.parametrize("other", [{"y": 20.2}, {"c": 2e-3}])
def test_every_axis_has_to_be_there(other):
    assert at(visits(), 0.0, 1.0, **other) is None


def test_targets_left_out_and_driven_to_again():
    found = visits()
    found.take(0)
    meant = at(found, 150.0, 1.0)
    assert meant == 3
    assert found.take(meant) == [1, 2]
    for x in PLACES[::-1]:
        found.take(at(found, x, -1.0))
    assert found.left == [1, 2]
    meant = at(found, 100.0, 1.0)
    assert meant == 2
    found.take(meant)
    assert found.left == [1]


def test_a_run_begun_anew_repeats():
    found = visits()
    for k in range(3):
        found.take(k)
    assert at(found, 0.0, 1.0) == 0
    assert found.taken(0)


def test_of_several_runs_the_one_that_is_expected():
    found = visits(runs=3)
    for k in range(8):
        found.take(k)
    assert at(found, 0.0, 1.0) == 8
    assert at(found, 150.0, -1.0) == 12


def test_one_way_a_target_met_from_the_other_side_is_that_target():
    found = visits(both_ways=False)
    assert at(found, 50.0, -1.0) == 1


def test_targets_too_near_to_tell_apart_are_refused():
    with pytest.raises(InputError, match="nearer to each other"):
        visits(places=np.array([0.0, 50.0, 50.15]))


def test_the_way_to_the_next():
    found = visits()
    found.take(0)
    assert found.distance({"X": 53.0, "Y": 24.0, "C": 0.0}) == pytest.approx(5.0)
