"""The noise floor from repeats: right where there is one, silent where there is none."""

import numpy as np
import pytest
from scipy import stats

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.noise import NoiseLevel, noise_floor
from abbe.compcore.campaign.repeats import approach, repeat_groups
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, Signal
from tests.support.compcore.campaign_texts import CMM, DATA

SIGMA = 0.5e-3


def campaign(time, value, x=0.0, *, kind=Kind.DISPLACEMENT, sd=np.nan, signals=None, **more):
    """Rows of one set-up along X; times in s, values in mm or rad."""
    n = len(time)
    x = np.broadcast_to(np.asarray(x, dtype=float), (n,))
    setup = more.get("setup", "s")
    directions = {"X": more["direction"]} if "direction" in more else {}
    conditions = Conditions(
        positions={"X": x, "Y": np.zeros(n), "Z": np.zeros(n)},
        directions=directions,
        time=np.asarray(time, dtype=float),
        signals=signals or {},
        run=np.zeros(n, dtype=np.int64),
        setup=np.broadcast_to(setup, (n,)),
        u=np.tile([1.0, 0.0, 0.0], (n, 1)),
    )
    return Campaign(
        "made",
        conditions,
        np.full(n, kind, dtype=np.int8),
        np.asarray(value, dtype=float),
        np.broadcast_to(np.asarray(sd, dtype=float), (n,)),
        np.zeros(n, dtype="U1"),
        np.zeros(n, dtype="U1"),
        np.arange(n),
    )


def covers(level: NoiseLevel, truth: float, confidence: float = 0.999) -> bool:
    """Whether an estimate agrees with the truth within its own degrees of freedom."""
    assert level.value is not None
    freedom = level.degrees_of_freedom
    low, high = stats.chi2.ppf([0.5 - confidence / 2, 0.5 + confidence / 2], freedom)
    return bool(low < freedom * (level.value / truth) ** 2 < high)


@pytest.mark.parametrize("folder", ["p01-mill", "p02-bridge", "p03-bridge"])
@pytest.mark.parametrize("part", ["fit", "check"])
def test_the_real_campaigns_noise_in_spite_of_hours_of_drift(folder, part):
    """Truth: 0.5 µm + 0.3 ppm of the length. The master points' plain spread is 0.8 to 3.9 µm."""
    model = load_model(DATA / folder / "model.toml")
    c = read_campaign(DATA / folder / f"{part}.csv", model.machine)
    floor = noise_floor(c, model.machine)
    level = floor.levels["displacement"]
    truth = float(np.sqrt(np.mean(c.sd[c.kind == Kind.DISPLACEMENT] ** 2)))
    assert level.value == pytest.approx(truth, rel=0.2)
    assert covers(level, truth)
    assert level.degrees_of_freedom > 50
    assert level.set_aside == ()
    assert set(level.setups) == {"master_x", "master_y", "master_z"}
    assert level.at_most is not None
    if part == "fit":
        rotation = floor.levels["rotation"]
        assert rotation.value is None
        assert "measured twice" in rotation.reason
        assert "cannot be known" in str(rotation)
        assert rotation.at_most == pytest.approx(0.6e-6, rel=0.1)
    else:
        assert "rotation" not in floor.levels


def test_the_interval_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(100, 500, 30))
    hits, estimates, trials = 0, [], 600
    for _ in range(trials):
        drift = rng.normal(0, 3e-6) * time  # even drift, µm an hour
        level = noise_floor(campaign(time, drift + rng.normal(0, SIGMA, 30))).levels["displacement"]
        assert level.interval is not None
        hits += level.interval[0] <= SIGMA <= level.interval[1]
        estimates.append(level.value)
    assert 0.92 < hits / trials < 0.98
    assert np.mean(np.square(estimates)) == pytest.approx(SIGMA**2, rel=0.03)
    # the effective degrees of freedom are those of the estimate's own scatter
    freedom = 2 * np.mean(np.square(estimates)) ** 2 / np.var(np.square(estimates))
    assert level.degrees_of_freedom == pytest.approx(freedom, rel=0.15)


def test_many_short_groups_are_pooled():
    """ISO 230-2: five runs, both ways, at eleven targets: repeats of five, each on its own line."""
    rng = np.random.default_rng(6)
    targets = np.linspace(0, 700, 11)
    x = np.concatenate([np.r_[targets, targets[::-1]] for _ in range(5)])
    direction = np.tile(np.r_[np.ones(11), -np.ones(11)], 5)
    time = 20.0 * np.arange(x.size)
    value = 0.02 * np.sin(x / 90) + 0.002 * direction + 1e-6 * time
    value += rng.normal(0, SIGMA, x.size)
    level = noise_floor(campaign(time, value, x, direction=direction)).levels["displacement"]
    assert covers(level, SIGMA)
    # three triples in each of 22 groups; overlapping ones count for less
    assert 30 < level.degrees_of_freedom < 66


def test_directions_that_are_not_recorded_follow_from_the_path():
    x = np.tile([0.0, 100.0, 200.0, 100.0], 10)
    play = np.where(np.arange(40) % 4 == 3, 0.05, 0.0)
    rng = np.random.default_rng(7)
    c = campaign(60.0 * np.arange(40), play + rng.normal(0, SIGMA, 40), x)
    assert covers(noise_floor(c).levels["displacement"], SIGMA)
    groups = repeat_groups(c)
    assert len(set(groups[x == 100.0])) == 2


def test_nothing_measured_twice():
    level = noise_floor(campaign(np.arange(9.0), np.zeros(9), np.arange(9.0)))
    assert level.levels["displacement"].value is None
    assert "measured twice" in level.levels["displacement"].reason
    assert level.value("rotation") is None


def test_repeats_hours_apart_say_nothing_of_noise():
    time = [0.0, 10_000.0, 20_000.0, 30_000.0]
    level = noise_floor(campaign(time, [0, 0.01, 0.013, 0.01])).levels["displacement"]
    assert level.value is None
    assert "too far apart" in level.reason


def test_pairs_close_in_time_count_but_say_what_they_hold():
    rng = np.random.default_rng(8)
    x = np.repeat(np.arange(40.0), 2)
    level = noise_floor(
        campaign(10.0 * np.arange(80), rng.normal(0, SIGMA, 80), x, direction=np.ones(80))
    ).levels["displacement"]
    assert covers(level, SIGMA)
    assert level.degrees_of_freedom == pytest.approx(40)
    assert "from pairs" in level.reason


def test_gross_errors_are_set_aside_and_named():
    rng = np.random.default_rng(9)
    value = rng.normal(0, SIGMA, 80)
    value[33] += 0.03
    level = noise_floor(campaign(100.0 * np.arange(80), value)).levels["displacement"]
    assert covers(level, SIGMA)
    assert 33 in level.set_aside
    assert len(level.set_aside) <= 3


def test_a_step_between_two_repeats_does_not_raise_the_floor():
    rng = np.random.default_rng(10)
    value = rng.normal(0, SIGMA, 80) + np.where(np.arange(80) > 40, 0.025, 0.0)
    level = noise_floor(campaign(100.0 * np.arange(80), value)).levels["displacement"]
    assert covers(level, SIGMA)


def test_drift_too_uneven_for_a_line_is_noticed():
    rng = np.random.default_rng(11)
    time = 600.0 * np.arange(80)
    rough = 5e-3 * np.sin(2 * np.pi * time / 6000.0)
    level = noise_floor(campaign(time, rough + rng.normal(0, SIGMA, 80))).levels["displacement"]
    assert level.value is None
    assert "too unevenly" in level.reason
    assert level.at_most is not None
    assert level.at_most > SIGMA


def test_readings_that_repeat_exactly_are_not_without_noise():
    level = noise_floor(campaign(60.0 * np.arange(9), np.zeros(9))).levels["displacement"]
    assert level.value is None
    assert "resolution" in level.reason


def test_stated_uncertainties_carry_the_floor_to_rows_that_were_not_repeated():
    """Repeats near the reflector are quiet; the campaign's other rows are far away."""
    rng = np.random.default_rng(12)
    near, far = np.zeros(200), np.arange(1.0, 201.0)
    sd = np.r_[np.full(200, 0.1e-3), np.full(200, 1e-3)]
    value = rng.normal(0, 2 * sd)
    level = noise_floor(
        campaign(30.0 * np.arange(400), value, np.r_[near, far], sd=sd, direction=np.ones(400))
    ).levels["displacement"]
    assert level.ratio == pytest.approx(2.0, rel=0.2)
    assert level.value == pytest.approx(2 * np.sqrt(np.mean(sd**2)), rel=0.2)
    assert level.setups["s"][0] == pytest.approx(0.2e-3, rel=0.2)


def test_another_load_on_the_table_is_another_measurement():
    rng = np.random.default_rng(13)
    load = np.tile([0.0, 500.0], 40)
    value = rng.normal(0, SIGMA, 80) + 1e-5 * load
    c = campaign(60.0 * np.arange(80), value, signals={"mass": load})
    machine = Machine(CMM.name, CMM.structure, CMM.axes, {"mass": Signal("mass", "kg", "load")})
    assert covers(noise_floor(c, machine).levels["displacement"], SIGMA)
    assert len(set(repeat_groups(c, machine))) == 2
    assert len(set(repeat_groups(c))) == 1


@pytest.mark.parametrize("kind", [Kind.ROTATION, Kind.DISTANCE])
def test_the_other_kinds(kind):
    rng = np.random.default_rng(14)
    offset = 400.0 if kind == Kind.DISTANCE else 0.0
    c = campaign(60.0 * np.arange(60), offset + rng.normal(0, SIGMA, 60), kind=kind)
    (level,) = noise_floor(c).levels.values()
    assert level.kind == kind.name.lower()
    assert covers(level, SIGMA)
    unit = "µrad" if kind == Kind.ROTATION else "µm"
    assert f" {unit} (95 %:" in str(level)


def test_rows_of_different_setups_runs_or_tools_are_no_repeats():
    base = campaign(60.0 * np.arange(4), np.zeros(4))
    assert repeat_groups(base).tolist() == [0, 0, 0, 0]
    other = campaign(60.0 * np.arange(4), np.zeros(4), setup=np.array(["a", "a", "b", "c"]))
    groups = repeat_groups(other)
    assert groups[0] == groups[1] >= 0
    assert groups[2:].tolist() == [-1, -1]
    slow = campaign(60.0 * np.arange(4), np.zeros(4), [0.0, 0.004, 0.02, 0.02])
    groups = repeat_groups(slow, both_ways=True)
    assert groups[0] == groups[1] != groups[2] == groups[3]


def test_the_approach_follows_from_the_order_of_rows():
    """ISO 230-2's cycle reads the ends twice: once coming, once coming back from beyond."""
    x = [0.0, 1.0, 2.0, 2.0, 1.0, 0.0, 0.0, 1.0]
    c = campaign(np.arange(8.0), np.zeros(8), x)
    assert approach(c, "X").tolist() == [1, 1, 1, -1, -1, -1, 1, 1]
    still = campaign(np.arange(5.0), np.zeros(5), [3.0, 3.0, 4.0, 4.0, 5.0])
    assert approach(still, "X").tolist() == [1, 1, 1, 1, 1]
    assert approach(still, "Y").tolist() == [0] * 5
    shuffled = campaign([2.0, 1.0, 0.0], np.zeros(3), [2.0, 1.0, 0.0])
    assert approach(shuffled, "X").tolist() == [1, 1, 1]


def test_distances_whose_uncertainties_differ_by_a_digit_have_the_noise_that_they_have():
    """Seen at a tracker that came back to its master point: a noise floor of 78 mm."""
    rng = np.random.default_rng(3)
    n = 60
    sd = SIGMA * rng.uniform(0.97, 1.03, n)
    value = 800.0 + sd * rng.standard_normal(n)
    found = noise_floor(campaign(30.0 * np.arange(n), value, kind=Kind.DISTANCE, sd=sd))
    assert covers(found.levels["distance"], SIGMA)
