"""A fitted model renewed by a later campaign, beside one fit of both campaigns together.

With uncertainties that are right, what an earlier campaign told and the rows of a later one are
independent data: the update is the fit of all rows at once, to rounding.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.renewing import NotRenewedError, known_of_others, renew
from abbe.compcore.files.campaign_file import read_campaign, read_campaigns
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.fitting.renewed import renewed
from abbe.compcore.model.model import Model, Value
from abbe.compcore.model.revise import with_effect

DATA = Path(__file__).parents[2] / "data" / "p02-bridge"
FIT, CHECK = DATA / "fit.csv", DATA / "check.csv"


def _unsure(campaign: Campaign) -> Campaign:
    """Uncertainties stated so large that nothing is inflated by what is left."""
    return replace(campaign, sd=2.0 * campaign.sd)


def _record(result: FitResult, ancestor: Model) -> Model:
    day = "2026-03-02T08:00:00+00:00"
    return recorded(result, ancestor, date=day, version="0", noise_floor=None)


@pytest.fixture(scope="module")
def bare() -> Model:
    return load_model(DATA / "model.toml")


@pytest.fixture(scope="module")
def earlier(bare: Model) -> Model:
    return _record(fit(bare, _unsure(read_campaign(FIT, bare.machine))), bare)


@pytest.fixture(scope="module")
def later(bare: Model) -> FitResult:
    return fit(bare, _unsure(read_campaign(CHECK, bare.machine)))


@pytest.fixture(scope="module")
def together(bare: Model) -> FitResult:
    return fit(bare, _unsure(read_campaigns([FIT, CHECK], bare.machine)))


def _values(model: Model) -> np.ndarray:
    return np.array([v.value for t in model.terms for v in t.values.values()])


def _sds(model: Model) -> np.ndarray:
    assert model.covariance is not None
    return np.sqrt(np.diag(model.covariance))


def _error(model: Model, campaign: Campaign) -> np.ndarray:
    return compare(model, campaign).residual


def test_it_is_the_fit_of_all_rows_at_once(
    earlier: Model, later: FitResult, together: FitResult
) -> None:
    found = renewed(later, earlier, ())
    every = read_campaign(FIT, earlier.machine)
    # the frame is a convention: what both say of a campaign is compared
    apart = _error(found.model, every) - _error(together.model, every)
    assert np.abs(apart).max() < 2e-6
    alone = _error(later.model, every) - _error(together.model, every)
    assert np.abs(alone).max() > 20.0 * max(2e-6, float(np.abs(apart).max()))
    ratio = _sds(found.model) / _sds(together.model)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.01)


def test_counted_once_also_where_it_is_renewed_again(
    earlier: Model, bare: Model, later: FitResult
) -> None:
    once = _record(renewed(later, earlier, ()), earlier)
    files = set(later.problem.campaign.files.values())
    assert known_of_others(once, files)
    again = renew(once, later, later)
    np.testing.assert_allclose(_values(again.model), _values(once), rtol=1e-3, atol=2e-8)
    np.testing.assert_allclose(_sds(again.model), _sds(once), rtol=0.02)


def test_an_effect_more_beside_what_was_known(
    earlier: Model, later: FitResult, together: FitResult
) -> None:
    """Renewed first, then another effect added: as if both had been done at once."""
    campaign = later.problem.campaign
    once = _record(renewed(later, earlier, ()), earlier)
    more, effect = with_effect(once, "backlash", {"axis": "Z"})
    wide = fit(more, campaign)
    at_once = renewed(wide, earlier, ())
    after = renew(once, later, wide)
    (one,) = [t.values["b"] for t in at_once.model.terms if t.effect == effect]
    (two,) = [t.values["b"] for t in after.model.terms if t.effect == effect]
    assert two.value == pytest.approx(one.value, rel=0.02, abs=1e-7)
    assert two.sd == pytest.approx(one.sd, rel=0.02)


def test_what_has_changed_is_let_go_and_the_rest_is_kept(earlier: Model, later: FitResult) -> None:
    spec = "squareness axes=Y,X"
    terms = list(earlier.terms)
    (i,) = [i for i, t in enumerate(terms) if t.effect.spec == spec]
    was = terms[i].values["angle"]
    terms[i] = replace(terms[i], values={"angle": Value(was.value + 50e-6, was.sd)})
    crashed = replace(earlier, terms=tuple(terms))
    found = renew(crashed, later, later)
    assert found.renewal is not None
    assert [e.spec for e in found.renewal.let_go] == [spec]
    value = found.model.terms[i].values["angle"]
    assert value.value == pytest.approx(was.value, abs=5.0 * value.sd)
    # alone, the later campaign is less sure of nearly everything
    assert np.mean(_sds(found.model) < 0.9 * _sds(later.model)) > 0.5


def test_it_is_refused_in_words(earlier: Model, bare: Model, later: FitResult) -> None:
    with pytest.raises(NotRenewedError, match="no values"):
        renew(bare, later, later)
    own = fit(bare, read_campaign(FIT, bare.machine))
    with pytest.raises(NotRenewedError, match="already"):
        renew(earlier, own, own)
    turned = replace(
        earlier,
        terms=tuple(
            replace(t, values={n: replace(v, value=-v.value) for n, v in t.values.items()})
            for t in earlier.terms
        ),
    )
    with pytest.raises(NotRenewedError, match="opposite"):
        renew(turned, later, later)


def test_rows_of_no_file_are_not_taken_for_others(earlier: Model, later: FitResult) -> None:
    assert not known_of_others(earlier, set())
    rows = fit(earlier, replace(later.problem.campaign, files={}))
    assert renew(earlier, rows, rows).renewal is not None  # asked for, it is done
    damaged = replace(earlier, fit={**earlier.fit, "renewed": True})
    assert renew(damaged, later, later).renewal is not None


def test_the_record_names_all_campaigns(earlier: Model, later: FitResult, tmp_path: Path) -> None:
    kept = _record(renewed(later, earlier, ()), earlier)
    assert [c["file"].split("/")[-1] for c in kept.fit["campaigns"]] == ["fit.csv", "check.csv"]
    low, high = kept.measured_signals["T_amb"]
    before, now = (m.measured_signals["T_amb"] for m in (earlier, _record(later, earlier)))
    assert (low, high) == (min(before[0], now[0]), max(before[1], now[1]))
    save_model(kept, tmp_path / "kept.toml")
    assert load_model(tmp_path / "kept.toml").fit["renewed"] == kept.fit["renewed"]
