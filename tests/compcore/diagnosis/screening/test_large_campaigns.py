"""A campaign of many rows: causes told apart on some of them, measured on all, as a refit does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.thinning import ENOUGH_ROWS, thinned
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model

DATA = Path(__file__).parents[3] / "data"


@pytest.fixture(scope="module")
def large() -> tuple[Model, Campaign]:
    """A bridge's campaign measured eight times over: each row with other noise, one s later."""
    model = load_model(DATA / "p03-bridge" / "model.toml")
    once = read_campaign(DATA / "p03-bridge" / "fit.csv", model.machine)
    many = once.rows(np.repeat(np.arange(once.n), 8))
    rng = np.random.default_rng(1)
    noise = many.sd * rng.standard_normal(many.n)
    later = replace(many.conditions, time=many.conditions.time + np.tile(np.arange(8.0), once.n))
    sd = np.sqrt(2.0) * many.sd
    return model, replace(many, conditions=later, value=many.value + noise, sd=sd)


def test_what_is_found_on_some_rows_is_what_a_refit_of_all_rows_says(
    large: tuple[Model, Campaign],
) -> None:
    model, campaign = large
    found = diagnose(model, campaign)
    assert found.whole.problem.n == campaign.n > 2 * found.result.problem.n
    effects = [e.found.candidate.effect for e in found.established]
    assert [e.spec for e in effects] == ["backlash axis=Z", "warm_up direction=X"]
    grown = replace(model, terms=model.with_effects(*effects).terms)
    refitted = fit(grown, campaign)
    assert found.left == pytest.approx(refitted.chi2_per_dof, rel=1e-4)
    for established, term in zip(found.established, refitted.model.terms[-2:], strict=True):
        for estimate in established.estimates:
            value = term.values[estimate.name]
            assert abs(estimate.value - value.value) < 0.1 * value.sd
            assert estimate.sd == pytest.approx(value.sd, rel=0.05)
    without = fit(model.with_effects(effects[1]), campaign)
    drop = found.established[0].found.screened.drop
    assert drop == pytest.approx(without.chi2 - refitted.chi2, rel=1e-3)
    assert found.rms == found.whole.rms(Kind.DISPLACEMENT)


def test_thinned_rows_keep_the_design(large: tuple[Model, Campaign]) -> None:
    _, campaign = large
    rows = thinned(campaign)
    assert rows is not None
    assert len(rows) == pytest.approx(ENOUGH_ROWS, rel=0.05)
    assert len(np.unique(rows)) == len(rows)
    kept = campaign.rows(rows)
    assert set(kept.setups) == set(campaign.setups)
    assert kept.conditions.setup is not None
    assert campaign.conditions.setup is not None
    share = len(rows) / campaign.n
    for name in campaign.setups:
        of_all = int((campaign.conditions.setup == name).sum())
        own = int((kept.conditions.setup == name).sum())
        assert own >= min(of_all, 12)
        assert own <= max(12, round(share * of_all) + 1)
    assert thinned(kept) is None


def test_many_set_ups_are_thinned_as_wholes(large: tuple[Model, Campaign]) -> None:
    _, campaign = large
    names = np.array([f"s{i // 16}" for i in range(campaign.n)])
    many = replace(campaign, conditions=replace(campaign.conditions, setup=names))
    rows = thinned(many, 2000)
    assert rows is not None
    assert len(rows) <= 2200
    counts = np.unique(names[rows], return_counts=True)[1]
    assert counts.min() >= 8
