"""Campaigns that state no uncertainties: from repeats, or from what is left over."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.fitting.fit import fit
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    DIRECTIONS,
    GEOMETRY,
    bridge,
    model,
    plane_rows,
    random_theta,
    with_truth,
)


def unstated(repeats: int):
    rng = np.random.default_rng(8)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows, sd=1.5e-3, rotation_sd=0.8e-6)
    if repeats:
        place = {"X": 350.0, "Y": 450.0, "Z": -180.0}
        time = np.arange(repeats) * 20.0
        zero = np.zeros(repeats)
        rows.add("m", Kind.DISPLACEMENT, place, zero, 1.5e-3, u=DIRECTIONS["X"], time=time)
    wanted = model(bridge(), *GEOMETRY)
    campaign = rows.campaign("plane")
    measured = with_truth(wanted, campaign, random_theta(wanted, campaign, rng), rng)
    return wanted, measured, replace(measured, sd=np.full(measured.n, np.nan))


def test_from_the_residuals_kind_by_kind() -> None:
    wanted, stated, campaign = unstated(0)
    result = fit(wanted, campaign)
    displacement = campaign.kind == Kind.DISPLACEMENT
    # 150 and 20 rows know their spread to 7 and 25 %
    assert result.problem.sd[displacement] == pytest.approx(1.5e-3, rel=0.2)
    assert result.problem.sd[~displacement] == pytest.approx(0.8e-6, rel=0.6)
    assert result.uncertainty.source[Kind.DISPLACEMENT] == "residuals"
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.02)
    known = fit(wanted, stated)
    sd = np.sqrt(np.diag(known.model.covariance))
    assert (np.abs(result.theta - known.theta) < 1.5 * sd + 1e-12).all()


def test_from_repeats_where_there_are_enough() -> None:
    wanted, _, campaign = unstated(60)
    result = fit(wanted, campaign)
    assert result.uncertainty.source[Kind.DISPLACEMENT] == "replicates"
    assert result.uncertainty.source[Kind.ROTATION] == "residuals"
    displacement = campaign.kind == Kind.DISPLACEMENT
    assert result.problem.sd[displacement] == pytest.approx(1.5e-3, rel=0.35)


def test_an_inadequate_model_makes_parameters_less_certain() -> None:
    wanted, campaign, _ = unstated(0)
    x = campaign.conditions.position("X")
    wavy = replace(campaign, value=campaign.value + 0.01 * np.sin(x / 20.0))
    good, poor = fit(wanted, campaign), fit(wanted, wavy)
    assert poor.chi2_per_dof > 5.0
    ratio = np.sqrt(np.diag(poor.model.covariance) / np.diag(good.model.covariance))
    expected = np.sqrt(poor.chi2_per_dof / max(1.0, good.chi2_per_dof))
    assert np.median(ratio) == pytest.approx(expected, rel=1e-6)
