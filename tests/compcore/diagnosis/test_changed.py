"""What has changed in a fitted model, and what is wrong with it or a campaign as a whole."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.changed import standing
from abbe.compcore.diagnosis.explain import changed
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model, Value
from abbe.daemon.application import app

DATA = Path(__file__).parents[2] / "data" / "p02-bridge"
Case = tuple[Model, Campaign]


@pytest.fixture(scope="module")
def case() -> Case:
    """A bridge fitted one day, and another day's campaign."""
    model = load_model(DATA / "model.toml")
    result = fit(model, read_campaign(DATA / "fit.csv", model.machine))
    day = "2026-03-02T08:00:00+00:00"
    fitted = recorded(result, model, date=day, version="0", noise_floor=None)
    check = read_campaign(DATA / "check.csv", model.machine)
    return fitted, replace(check, metadata=[{**check.metadata[0], "date": "2026-09-01"}])


def _moved(model: Model, spec: str, name: str, by: float) -> Model:
    terms = list(model.terms)
    (i,) = [i for i, t in enumerate(terms) if t.effect.spec == spec]
    values = dict(terms[i].values)
    values[name] = Value(values[name].value + by, values[name].sd)
    terms[i] = replace(terms[i], values=values)
    return replace(model, terms=tuple(terms))


def test_another_day_agrees_with_the_model(case: Case) -> None:
    model, campaign = case
    holds = standing(model, fit(model, campaign).thin)
    assert holds is not None
    assert holds.chance > 1e-3
    assert not holds.changes
    assert not holds.suspicions
    assert diagnose(model, campaign).verdict == "complete"


@pytest.mark.parametrize(
    ("spec", "name", "by"),
    [
        ("squareness axes=Y,X", "angle", 50e-6),
        ("squareness axes=Y,X", "angle", -5e-6),
        ("scale_expansion axis=Y signals=T_y", "alpha", 4e-6),
        ("straightness axis=X direction=Y", "c4", 6e-3),
    ],
)
def test_the_effect_that_changed_is_named(case: Case, spec: str, name: str, by: float) -> None:
    model, campaign = case
    given = _moved(model, spec, name, by)
    found = diagnose(given, campaign)
    assert found.verdict == "changed"
    assert found.standing is not None
    (change,) = found.standing.changes
    assert change.effect.spec == spec
    assert found.standing.since == "2026-03-02"
    assert found.standing.else_holds
    if len(change.parameters) == 1:
        (p,) = change.parameters
        assert abs(p.by + by) < 4.0 * p.sd
        assert p.sd < 0.1 * abs(by)


def test_since_when_is_said_only_of_a_campaign_that_is_of_a_later_day(case: Case) -> None:
    model, campaign = case
    given = _moved(model, "squareness axes=Y,X", "angle", 50e-6)
    of_fit = {"conditions": {"date": "2026-02-20"}}
    stated = replace(given, fit={**given.fit, "campaigns": [of_fit]})
    for model_now, day, since in (
        (given, None, None),
        (given, "last summer", None),
        (given, "2026-03-01", None),
        (stated, "2026-03-01", "2026-02-20"),
    ):
        head = {} if day is None else {"date": day}
        other = replace(campaign, metadata=[head])
        holds = standing(model_now, fit(model_now, other).thin)
        assert holds is not None
        assert holds.since == since
        (said, _) = changed(holds)
        told = "since 2026-02-20: " if since else "(against the model of 2026-03-02): "
        assert said.startswith(f"squareness axes=Y,X changed {told}angle by -")


def test_two_changes_are_both_named(case: Case) -> None:
    model, campaign = case
    given = _moved(model, "squareness axes=Y,X", "angle", 30e-6)
    given = _moved(given, "scale_expansion axis=Y signals=T_y", "alpha", -5e-6)
    holds = standing(given, fit(given, campaign).thin)
    assert holds is not None
    assert {c.effect.spec for c in holds.changes} == {
        "squareness axes=Y,X",
        "scale_expansion axis=Y signals=T_y",
    }


def test_all_signs_flipped_is_said_before_anything_else(case: Case) -> None:
    model, campaign = case
    turned = [{k: Value(-v.value, v.sd) for k, v in t.values.items()} for t in model.terms]
    found = diagnose(model.with_values(turned), campaign)
    assert found.verdict == "changed"
    assert found.standing is not None
    assert "sign" in found.standing.suspicions[0]
    assert not found.standing.changes


def test_degrees_fahrenheit_are_recognised(case: Case) -> None:
    model, campaign = case
    conditions = campaign.conditions
    signals = {
        n: v * 1.8 + 32.0 if model.machine.signals[n].temperature else np.asarray(v)
        for n, v in conditions.signals.items()
    }
    hot = replace(campaign, conditions=replace(conditions, signals=signals))
    holds = standing(model, fit(model, hot).thin)
    assert holds is not None
    assert any("°F" in s for s in holds.suspicions)


def test_a_model_without_values_cannot_have_changed(case: Case) -> None:
    model, campaign = case
    blank = replace(model, terms=tuple(replace(t, values={}) for t in model.terms), covariance=None)
    assert standing(blank, fit(blank, campaign).thin) is None


def test_the_commands_say_it(case: Case, tmp_path: Path) -> None:
    model, _ = case
    path, check = tmp_path / "given.toml", DATA / "check.csv"
    save_model(_moved(model, "squareness axes=Y,X", "angle", 50e-6), path)
    runner = CliRunner()
    said = runner.invoke(app, ["diagnose", str(path), str(check)])
    assert said.exit_code == 0, said.output
    told = "squareness axes=Y,X changed (against the model of 2026-03-02): angle by -"
    assert told in said.stdout
    assert "everything else of the model holds" in said.stdout
    answer = json.loads(runner.invoke(app, ["diagnose", str(path), str(check), "--json"]).stdout)
    assert answer["verdict"] == "changed"
    (change,) = answer["changed"]
    assert change["spec"] == "squareness axes=Y,X"
    assert change["p_value"] < 1e-12
    assert change["confusable_with"] == []
    angle = change["parameters"]["angle"]
    (term,) = [t for t in model.terms if t.effect.spec == "squareness axes=Y,X"]
    was = term.values["angle"].value + 50e-6
    assert angle["was"] == pytest.approx(was, abs=1e-12)
    assert angle["is"] == pytest.approx(was - 50e-6, abs=2e-6)
    assert angle["unit"] == "rad"
    assert 0.0 < angle["sd"] < 1e-6
    beside = json.loads(runner.invoke(app, ["compare", str(path), str(check), "--json"]).stdout)
    assert answer["as_given"]["rms"] == pytest.approx(beside["rms"])
    assert answer["as_given"]["chi2_per_dof"] == pytest.approx(beside["chi2_per_dof"])
    assert any(s.startswith("χ²/dof") for s in answer["as_given"]["suspicions"])
    assert answer["rms"] < answer["as_given"]["rms"]
    said = runner.invoke(app, ["compare", str(path), str(check)])
    assert said.exit_code == 0, said.output
    lines = said.stdout.splitlines()
    assert lines[0].startswith("SUSPICIOUS: χ²/dof")
    assert "DOES NOT HOLD" in lines[1]
    assert "squareness axes=Y,X changed" in lines[2]
    assert "next: abbe diagnose" in said.stdout


def test_a_model_that_holds_is_compared_without_a_warning(case: Case, tmp_path: Path) -> None:
    model, _ = case
    path = tmp_path / "given.toml"
    save_model(model, path)
    said = CliRunner().invoke(app, ["compare", str(path), str(DATA / "check.csv")])
    assert said.exit_code == 0, said.output
    assert "DOES NOT HOLD" not in said.stdout


def test_a_thermometer_with_the_wrong_sign_is_suspected_and_nothing_is_to_be_fitted(
    case: Case,
) -> None:
    """Mirrored about 20 °C: an expansion of −10 ppm/K, which no material has."""
    model, campaign = case
    signals = dict(campaign.conditions.signals)
    signals["T_y"] = 40.0 - signals["T_y"]
    mirrored = replace(campaign, conditions=replace(campaign.conditions, signals=signals))
    found = diagnose(model, mirrored)
    assert found.standing is not None
    said = " ".join(found.standing.suspicions)
    assert "scale_expansion axis=Y signals=T_y: alpha would be negative" in said
    assert "T_y may be read with the wrong sign" in said


def test_an_exchanged_thermometer_before_seven_coefficients_of_its_scale(case: Case) -> None:
    """What reads 1.5 K too much since was a change of positioning before, up to some 10 µm."""
    model, campaign = case
    signals = {**campaign.conditions.signals, "T_y": campaign.conditions.signal("T_y") + 1.5}
    warmer = replace(campaign, conditions=replace(campaign.conditions, signals=signals))
    holds = standing(model, fit(model, warmer).thin)
    assert holds is not None
    assert holds.else_holds
    (change,) = holds.changes
    assert change.effect.spec == "sensor_offset signal=T_y"
    assert change.own in model.effects
    (offset,) = change.parameters
    assert offset.after == pytest.approx(1.5, abs=3.0 * offset.sd)
    assert offset.sd < 0.2
