"""Non-linear parameters: time constants, periods, moments, from far starts; steps and offsets."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import DIRECTIONS, bridge, model, with_truth


def day(machine: Machine, seed: int = 0, n: int = 400) -> tuple[Campaign, np.random.Generator]:
    """A day of X positions in random order while the shop warms and cools; all in one set-up."""
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0.0, 30_000.0, n))
    warm = 20.0 + 2.0 * np.sin(time / 6000.0) + 0.5 * np.sin(time / 900.0 + 1.0)
    rows = Rows(("X", "Y", "Z"))
    rows.add(
        "day",
        Kind.DISPLACEMENT,
        {"X": rng.uniform(0.0, 700.0, n), "Y": 400.0, "Z": -100.0},
        np.zeros(n),
        0.5e-3,
        u=DIRECTIONS["X"],
        time=time,
        signals={"T": warm},
    )
    return rows.campaign("day"), rng


def recovered(machine: Machine, specs: tuple[str, ...], truth: dict[str, float], seed: int = 0):
    """Truth by unknown's name, and what the fit finds with its standard deviation."""
    campaign, rng = day(machine, seed)
    wanted = model(machine, *specs)
    layout = Problem(wanted, campaign).layout
    theta = np.array([truth[u.name] for u in layout.unknowns])
    result = fit(wanted, with_truth(wanted, campaign, theta, rng))
    found = {k: v for t in result.model.terms for k, v in t.values.items()}
    return result, found


def test_a_time_constant_is_found_within_its_uncertainty() -> None:
    truth = {"k": 5e-6, "alpha": 12e-6, "tau": 2400.0}
    specs = ("scale axis=X", "scale_expansion axis=X signals=T tau=fit")
    result, found = recovered(bridge("T"), specs, truth)
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    for name, value in truth.items():
        assert abs(found[name].value - value) < 4.0 * found[name].sd
    assert found["tau"].sd < 200.0


def test_uncertainty_of_a_time_constant_is_honest() -> None:
    truth = {"k": 5e-6, "alpha": 12e-6, "tau": 2400.0}
    specs = ("scale axis=X", "scale_expansion axis=X signals=T tau=fit")
    pulls = []
    for seed in range(40):
        _, found = recovered(bridge("T"), specs, truth, seed)
        pulls.append((found["tau"].value - truth["tau"]) / found["tau"].sd)
    # the standard deviation of 40 normal numbers is known to 11 %
    assert np.std(pulls) == pytest.approx(1.0, abs=0.45)


def test_warm_up_and_lag_are_found_together() -> None:
    machine = bridge("T")
    campaign, rng = day(machine, 7)
    wanted = model(machine, "scale_expansion axis=X signals=T tau=fit", "warm_up direction=X")
    problem = Problem(wanted, campaign)
    names = [u.name for u in problem.layout.unknowns]
    theta = np.zeros(len(names))
    theta[:2] = 10e-6, 1200.0
    theta[names.index("tau", 2)] = 5200.0
    theta[[i for i in (2, 3) if names[i] != "tau"]] = 6e-3
    result = fit(wanted, with_truth(wanted, campaign, theta, rng))
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    sd = np.sqrt(np.diag(result.model.covariance))
    assert (np.abs(result.theta - theta) < 5.0 * sd).all()


def test_the_moment_of_a_step_lies_between_the_rows_that_show_it() -> None:
    machine = bridge("T")
    campaign, rng = day(machine, 3)
    wanted = model(machine, "scale axis=X", "event direction=X")
    problem = Problem(wanted, campaign)
    names = [u.name for u in problem.layout.unknowns]
    theta = np.zeros(len(names))
    theta[names.index("t0")] = 17_000.0
    theta[[i for i in range(1, len(names)) if names[i] != "t0"]] = 5e-3
    result = fit(wanted, with_truth(wanted, campaign, theta, rng))
    time = campaign.conditions.time
    moment = result.model.terms[1].values["t0"]
    before, after = time[time < 17_000.0].max(), time[time >= 17_000.0].min()
    assert before <= moment.value <= after
    assert 0.1 * (after - before) < moment.sd < 3.0 * (after - before)
    assert not [u for u in result.undetermined if "t0" in u.text]
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.25)


def test_a_period_is_found_among_many_valleys() -> None:
    machine = bridge("T")
    campaign, rng = day(machine, 4)
    wanted = model(machine, "cyclic axis=X period=fit")
    problem = Problem(wanted, campaign)
    names = [u.name for u in problem.layout.unknowns]
    theta = np.zeros(len(names))
    theta[0] = 4e-3
    theta[names.index("period")] = 10.03
    result = fit(wanted, with_truth(wanted, campaign, theta, rng))
    period = result.model.terms[0].values["period"]
    assert abs(period.value - 10.03) < 5.0 * period.sd
    assert period.sd < 0.01


def test_a_thermometers_offset_is_found_through_the_effect_that_reads_it() -> None:
    machine = bridge("T")
    campaign, rng = day(machine, 5)
    wanted = model(machine, "scale_expansion axis=X signals=T", "sensor_offset signal=T")
    theta = np.array([12e-6, 0.8])
    result = fit(wanted, with_truth(wanted, campaign, theta, rng))
    offset = result.model.terms[1].values["offset"]
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    assert abs(offset.value - 0.8) < 4.0 * offset.sd
    assert offset.sd < 0.05


def test_a_thermometers_gain_is_found_through_the_mean_that_reads_it() -> None:
    """Of two thermometers on a scale one magnifies: their mean is not what one factor explains."""
    machine = bridge("T", "T_far")
    campaign, rng = day(machine, 6)
    conditions = campaign.conditions
    far = 20.0 + 1.5 * np.sin(conditions.time / 4000.0 + 0.5)
    conditions = replace(conditions, signals={**conditions.signals, "T_far": far})
    campaign = replace(campaign, conditions=conditions)
    wanted = model(machine, "scale_expansion axis=X signals=T,T_far", "sensor_gain signal=T")
    theta = np.array([12e-6, 0.15])
    result = fit(wanted, with_truth(wanted, campaign, theta, rng))
    gain = result.model.terms[1].values["gain"]
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    assert abs(gain.value - 0.15) < 4.0 * gain.sd
    assert gain.sd < 0.05


def test_exact_composition_is_fitted_as_it_predicts() -> None:
    machine = bridge()
    rng = np.random.default_rng(2)
    rows = Rows(("X", "Y", "Z"))
    n = 200
    place = {"X": rng.uniform(0, 700, n), "Y": rng.uniform(0, 900, n), "Z": rng.uniform(-360, 0, n)}
    for axis, u in DIRECTIONS.items():
        rows.add(axis, Kind.DISPLACEMENT, place, np.zeros(n), 1e-6, u=u, free=())
    specs = ("angular axis=Y about=X shape=polynomial:1", "angular axis=X about=Y shape=constant")
    first = model(machine, *specs)
    exact = Model(machine, first.terms, composition="exact")
    theta = np.array([4e-4, 3e-4, -4e-4])
    campaign = with_truth(exact, rows.campaign("exact"), theta)
    assert fit(exact, campaign).chi2 < 1e-6
    assert fit(exact, campaign).theta == pytest.approx(theta, rel=1e-6)
    assert fit(first, campaign).chi2 > 1e3
