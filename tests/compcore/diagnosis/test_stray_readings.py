"""A reading that stands alone drives no cause into a model and hides none; what is true stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import LENGTHS, Campaign
from abbe.compcore.diagnosis import Diagnosis, diagnose
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect

DATA = Path(__file__).parents[2] / "data"


def given(name: str, campaign: str = "fit.csv") -> tuple[Model, Campaign]:
    model = load_model(DATA / name / "model.toml")
    return model, read_campaign(DATA / name / campaign, model.machine)


def misread(campaign: Campaign, rows: list[int], off: float) -> Campaign:
    """Some rows off by so many of their standard uncertainties."""
    value = campaign.value.copy()
    value[rows] += off * campaign.sd[rows]
    return replace(campaign, value=value)


def lines(found: Diagnosis) -> set[int]:
    return {s.line for s in found.strays}


def named(found: Diagnosis) -> list[str]:
    return [e.effect.spec for e in found.established]


@pytest.mark.parametrize("name", ["p01-mill", "p02-bridge", "p03-bridge"])
def test_none_where_none_is(name: str) -> None:
    assert diagnose(*given(name)).strays == ()


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("seed", "off"), [(1, 20.0), (2, 20.0), (3, 40.0), (4, -400.0)])
def test_one_reading_makes_no_cause(seed: int, off: float) -> None:
    """Of twelve rows that are off by 40 standard uncertainties eleven made causes before."""
    model, campaign = given("p02-bridge")
    row = int(np.random.default_rng(seed).integers(campaign.n))
    found = diagnose(model, misread(campaign, [row], off))
    assert found.verdict == "complete"
    assert lines(found) == {int(campaign.line[row])}
    (stray,) = found.strays
    assert stray.setup == campaign.conditions.setup[row]  # type: ignore[index]
    assert stray.off == pytest.approx(off * campaign.sd[row], rel=0.2)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("off", [40.0, 300.0])
def test_several_hide_no_cause(off: float) -> None:
    """Two beside one another, one of another set-up; a rotation."""
    model, campaign = given("p03-bridge")
    rows = [399, 700, 701, 899]
    found = diagnose(model, misread(campaign, rows, off))
    assert named(found) == ["backlash axis=Z", "warm_up direction=X"]
    assert lines(found) == {int(campaign.line[r]) for r in rows}


@pytest.mark.thorough
def test_on_the_way_to_the_verdict_they_count_no_more() -> None:
    model, campaign = given("p03-bridge")
    rows = [399, 700, 899]
    clean = to_the_verdict(model, campaign)
    course = to_the_verdict(model, misread(campaign, rows, 40.0))
    aside = [s for s in course.steps if s.action == "set aside"]
    assert {s.line for step in aside for s in step.strays} == {int(campaign.line[r]) for r in rows}
    assert {s.line for s in course.diagnosis.strays} == {int(campaign.line[r]) for r in rows}
    one, two = clean.last.result.model, course.last.result.model
    assert one.effects == two.effects
    for term, other in zip(one.terms, two.terms, strict=True):
        for name, value in term.values.items():
            assert value.value == pytest.approx(other.values[name].value, abs=value.sd or 0.0)


def test_what_is_promised_is_what_a_robust_fit_delivers() -> None:
    model, campaign = given("p03-bridge")
    spoilt = misread(campaign, [399, 700, 899], 40.0)
    found = diagnose(model, spoilt)
    first = found.established[0]
    more, _ = with_effect(model, first.effect.kind, first.effect.where())
    assert fit(more, spoilt, robust=True).rms(*LENGTHS) == pytest.approx(first.rms_after, rel=0.03)


def test_many_readings_of_one_set_up_are_no_strays() -> None:
    """A mirror that stood askew for a third of a line is something that happened."""
    model, campaign = given("p02-bridge")
    setup = campaign.conditions.setup
    assert setup is not None
    rows = np.flatnonzero(setup == setup[399])[::3]
    assert len(rows) > 5
    found = diagnose(model, misread(campaign, rows.tolist(), 40.0))
    assert not lines(found) & set(campaign.line[rows].tolist())


def test_what_comes_again_is_no_stray() -> None:
    """A dent is met each time that the axis passes it, though by one target of each line only."""
    model, campaign = given("p02-bridge")
    c = campaign.conditions
    assert c.setup is not None
    same = np.ones(campaign.n, dtype=bool)
    for position in c.positions.values():
        same &= np.abs(position - position[399]) < 1e-6
    rows = np.flatnonzero(same & (c.setup == c.setup[399]))
    assert len(rows) > 1
    found = diagnose(model, misread(campaign, rows.tolist(), 40.0))
    assert not lines(found) & set(campaign.line[rows].tolist())


@pytest.mark.thorough
def test_long_tails_of_real_readings_are_no_strays() -> None:
    """Of 454 stars a dozen lie beyond five standard deviations, none apart from all others."""
    course = to_the_verdict(*given("real/r02-mount", "run.csv"))
    assert course.diagnosis.strays == ()
