"""Standing still against the noise of positions, and averages that are steady or not."""

import math
import random

import pytest

from abbe.daemon.measure.following.average import Averaging, unsteady
from abbe.daemon.measure.following.standstill import Standstill


def follow(positions, period=0.02, noise=0.003, lasting=0.5):
    """For each sample, whether the machine stands."""
    watch = Standstill([noise, noise], lasting)
    return [watch.step(k * period, [x, 7.0]) for k, x in enumerate(positions)]


def test_it_stands_half_a_second_after_it_came_to_rest_in_noise():
    rng = random.Random(1)
    way = [k * 1.0 for k in range(50)] + [50.0] * 100
    found = follow([x + rng.uniform(-1e-3, 1e-3) for x in way])
    assert not any(found[:74])
    assert all(found[77:])


def test_noise_larger_than_it_may_be_is_motion():
    rng = random.Random(2)
    assert not any(follow([rng.uniform(-0.01, 0.01) for _ in range(200)]))


def test_a_creep_is_motion_in_the_end():
    # 4 µm/s: within the noise for 0.75 s, then not
    found = follow([4e-3 * 0.02 * k for k in range(200)])
    assert any(found)
    assert not all(found[60:])


def test_a_stop_that_was_too_short():
    assert not any(follow([0.0] * 20 + [k * 0.5 for k in range(40)]))


def test_leaving_is_seen_at_once_and_the_next_rest_takes_its_time():
    found = follow([0.0] * 50 + [1.0] * 50)
    assert found[49]
    assert not found[50]
    assert not any(found[50:74])
    assert found[77]


def averaged(values, begins=0.0, lasts=1.0):
    made = Averaging(begins, lasts)
    for k, value in enumerate(values):
        made.add(0.05 * (k + 1), [value], [1.0, 2.0])
    return made


def test_mean_spread_and_drift():
    found = averaged([1.0, 2.0, 3.0, 4.0]).result()
    assert found.values == (2.5,)
    assert found.drifts == (2.0,)
    assert found.spreads[0] == pytest.approx(math.sqrt(5.0 / 3.0))
    assert found.positions == (1.0, 2.0)


def test_the_same_reading_counts_once_and_what_was_too_early_never():
    made = Averaging(1.0, 0.1)
    for time in (0.5, 0.99, 1.0, 1.0, 1.05):
        made.add(time, [time], [0.0])
    assert not made.full(9.0)
    made.add(1.2, [3.0], [0.0])
    made.add(1.3, [3.0], [0.0])
    assert made.full(9.0)
    assert made.result().count == 4


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ([1e-4, -1e-4] * 10, ""),
        ([5e-3, -5e-3] * 10, "spread"),
        ([5e-5 * k for k in range(20)], ""),
        ([2e-4 * k for k in range(20)], "drift"),
    ],
)
def test_steady_or_not(values, why):
    limit = {"": 1.0, "spread": 3e-3, "drift": 3e-3}[why]
    assert unsteady(averaged(values).result(), 0.3e-3, limit) == why


def test_the_uncertainty_of_noise_is_that_of_its_mean():
    """Of 2000 averages of 25 readings, scatter of the means and stated uncertainty agree."""
    rng = random.Random(3)
    means, stated = [], []
    for _ in range(2000):
        found = averaged([rng.gauss(0.0, 1.0) for _ in range(25)]).result()
        means.append(found.values[0])
        stated.append(found.sd(0, 0.0))
    scatter = math.sqrt(sum(m * m for m in means) / len(means))
    mean = math.sqrt(sum(s * s for s in stated) / len(stated))
    # the drift is noise here: it adds 4/25/12 to 1/25
    assert mean / scatter == pytest.approx(math.sqrt(1.0 + 4.0 / 12.0), rel=0.05)
