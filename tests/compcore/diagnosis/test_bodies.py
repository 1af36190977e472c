"""Bodies behind a signal: one lag, two, one that was warm before the first reading."""

from __future__ import annotations

import math

import pytest

from abbe.compcore.diagnosis.screening.candidates import candidates
from abbe.compcore.diagnosis.stepwise import Course, to_the_verdict
from abbe.compcore.effects import make_effect
from abbe.compcore.errors import InputError
from tests.support.compcore.bodies import MINUTE, growth


def reached(course: Course) -> dict[str, float]:
    (term,) = course.last.result.model.terms
    return {name: v.value for name, v in term.values.items()}


def test_one_body_is_one_lag() -> None:
    course = to_the_verdict(*growth(1, [(0.03, 900.0, None)]))
    (effect,) = course.last.result.model.effects
    assert effect.spec == "thermal_offset direction=Z signal=n tau=fit"
    assert reached(course)["tau"] == pytest.approx(900.0, rel=0.05)


def test_bearing_and_head_are_two() -> None:
    course = to_the_verdict(*growth(2, [(0.02, 300.0, None), (0.03, 3000.0, None)]))
    (effect,) = course.last.result.model.effects
    assert effect.spec == "thermal_offset direction=Z signal=n tau=fit tau2=fit"
    found = reached(course)
    (fast, quick), (slow, late) = sorted([(found["tau"], found["k"]), (found["tau2"], found["k2"])])
    assert fast == pytest.approx(300.0, rel=0.1)
    assert slow == pytest.approx(3000.0, rel=0.15)
    assert quick * 1e4 == pytest.approx(0.02, rel=0.1)
    assert late * 1e4 == pytest.approx(0.03, rel=0.1)
    assert course.diagnosis.verdict == "complete"


def test_a_body_that_was_warm_before_the_first_reading() -> None:
    """It stood at 0.8 of full speed's warmth while the spindle stood still or ran."""
    course = to_the_verdict(*growth(3, [(0.03, 1800.0, 0.8)]))
    (effect,) = course.last.result.model.effects
    assert effect.spec == "thermal_offset direction=Z signal=n tau=fit start=fit"
    assert reached(course)["tau"] == pytest.approx(1800.0, rel=0.05)
    result = course.last.result
    first = result.problem.campaign.conditions.signal("n")[0] / 1e4
    (start,) = result.problem.layout.starts
    # k·δ in mm: what the body had more of at first than its signal says
    assert result.theta[start.where] == pytest.approx([0.03 * (0.8 - first)], rel=0.05)


def test_a_lag_is_no_shorter_than_the_time_between_readings() -> None:
    model, campaign = growth(4, [(0.03, 900.0, None)])
    assert campaign.coverage().interval == MINUTE
    lagged = make_effect("thermal_offset", {"direction": "Z", "signal": "n", "tau": "fit"})
    (tau,) = lagged.search(model.machine, campaign.coverage())
    assert tau.bounds[0] == MINUTE
    assert min(tau.starts) >= MINUTE


@pytest.mark.parametrize("key", ["tau2", "start"])
def test_neither_stands_without_a_lag(key: str) -> None:
    with pytest.raises(InputError, match="beside a first lag"):
        make_effect("thermal_offset", {"direction": "Z", "signal": "n", key: "fit"})


def test_in_one_place_a_lean_by_one_signal_is_the_shift_that_it_is() -> None:
    model, campaign = growth(5, [(0.03, 900.0, None)])
    assert not campaign.coverage().levers
    kinds = {c.effect.kind for c in candidates(model, campaign)}
    assert "thermal_offset" in kinds
    assert "thermal_tilt" not in kinds
    assert not math.isnan(campaign.coverage().interval)
