"""Outliers: found, listed by line, and without influence; none invented."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.fitting.fit import fit
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    GEOMETRY,
    bridge,
    model,
    plane_rows,
    random_theta,
    with_truth,
)


def measured(seed: int):
    rng = np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    wanted = model(bridge(), *GEOMETRY)
    campaign = rows.campaign("plane")
    theta = random_theta(wanted, campaign, rng)
    return wanted, with_truth(wanted, campaign, theta, rng), rng


@pytest.mark.parametrize("seed", range(4))
def test_gross_errors_are_listed_and_cost_nothing(seed: int) -> None:
    wanted, campaign, rng = measured(seed)
    bad = np.sort(rng.choice(campaign.n, 8, replace=False))
    value = campaign.value.copy()
    value[bad] += rng.choice([-1.0, 1.0], 8) * rng.uniform(15.0, 3000.0, 8) * campaign.sd[bad]
    spoilt = replace(campaign, value=value)
    clean = fit(wanted, campaign)
    result = fit(wanted, spoilt, robust=True)
    assert {o.row for o in result.set_aside} == set(bad.tolist())
    assert [o.line for o in result.outliers] == [int(campaign.line[o.row]) for o in result.outliers]
    sizes = [o.size for o in result.outliers]
    assert sizes == sorted(sizes, reverse=True)
    sd = np.sqrt(np.diag(result.model.covariance))
    assert (np.abs(result.theta - clean.theta) < 2.0 * sd + 1e-12).all()
    assert result.dof == clean.dof - 8
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.35)
    # the rows are still there, with the residual that they have
    assert result.residual.shape == (campaign.n,)
    assert (np.abs(result.residual[bad]) > 8.0 * campaign.sd[bad]).all()


def test_without_the_option_outliers_are_reported_but_used() -> None:
    wanted, campaign, _ = measured(1)
    value = campaign.value.copy()
    value[30] += 60.0 * campaign.sd[30]
    result = fit(wanted, replace(campaign, value=value))
    assert not result.set_aside
    assert result.outliers[0].row == 30
    assert np.isfinite(result.problem.sd).all()


def test_none_are_invented() -> None:
    outliers = 0
    for seed in range(12):
        wanted, campaign, _ = measured(20 + seed)
        outliers += len(fit(wanted, campaign, robust=True).set_aside)
    assert outliers <= 1
