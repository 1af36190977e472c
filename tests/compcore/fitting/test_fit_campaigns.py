"""The three campaigns with known answers: χ² falls to 1 once what was hidden is added."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.effects import make_effect
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import format_model, load_model, parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit

DATA = Path(__file__).parents[2] / "data"
TILT = ("thermal_tilt", {"axis": "Y", "about": "X", "signals": "T_col_front,T_col_rear"})
HIDDEN = {
    "p01-mill": [TILT],
    "p02-bridge": [],
    "p03-bridge": [("backlash", {"axis": "Z"}), ("warm_up", {"direction": "X"})],
}


def given_(folder: str):
    model = load_model(DATA / folder / "model.toml")
    return model, read_campaign(DATA / folder / "fit.csv", model.machine)


@pytest.mark.parametrize("folder", HIDDEN)
def test_what_was_hidden_brings_chi_square_to_one(folder: str) -> None:
    model, campaign = given_(folder)
    before = fit(model, campaign)
    whole = model.with_effects(*(make_effect(kind, keys) for kind, keys in HIDDEN[folder]))
    after = fit(whole, campaign)
    assert after.chi2_per_dof == pytest.approx(1.0, abs=0.06)
    assert not after.misfit
    assert before.misfit == bool(HIDDEN[folder])
    check = read_campaign(DATA / folder / "check.csv", model.machine)
    held_out = compare(after.model, check).lengths
    assert held_out.rms < 0.62e-3
    assert held_out.rms <= compare(before.model, check).lengths.rms + 1e-9
    if folder == "p03-bridge":
        warm_up = after.model.terms[-1].values
        assert abs(warm_up["A"].value - 4e-3) < 3.0 * warm_up["A"].sd
        assert abs(warm_up["tau"].value - 5200.0) < 3.0 * warm_up["tau"].sd


def test_a_fitted_model_predicts_the_same_after_it_was_saved() -> None:
    model, campaign = given_("p02-bridge")
    fitted = fit(model, campaign).model
    again = parse_model(TomlSource(format_model(fitted)))
    assert again == fitted
    ours = fitted.predict(campaign.conditions).translation
    assert (again.predict(campaign.conditions).translation == ours).all()


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_rows_does_not_matter(seed: int) -> None:
    model, campaign = given_("p02-bridge")
    order = np.random.default_rng(seed).permutation(campaign.n)
    shuffled = campaign.rows(order)
    one, other = fit(model, campaign), fit(model, shuffled)
    assert other.chi2 == pytest.approx(one.chi2, rel=1e-9)
    assert other.residual == pytest.approx(one.residual[order], abs=1e-9)
    ours = one.model.predict(campaign.conditions).translation
    theirs = other.model.predict(campaign.conditions).translation
    assert theirs == pytest.approx(ours, abs=1e-6)


def test_a_unit_of_weight_makes_no_difference_to_values() -> None:
    from dataclasses import replace

    model, campaign = given_("p02-bridge")
    one = fit(model, campaign)
    other = fit(model, replace(campaign, sd=2.0 * campaign.sd))
    assert other.residual == pytest.approx(one.residual, abs=1e-8)
    assert other.chi2 == pytest.approx(one.chi2 / 4.0, rel=1e-6)
    assert other.rms(Kind.ROTATION) == pytest.approx(one.rms(Kind.ROTATION))
