"""Bodies behind a signal: one lag, two, one that was warm before the first reading."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.screening.candidates import candidates
from abbe.compcore.diagnosis.stepwise import Course, to_the_verdict
from abbe.compcore.effects import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

F64 = NDArray[np.float64]

MINUTE = 60.0


def body(speed: F64, tau: float, begins: float | None) -> F64:
    """A body that follows a speed, by small steps of its heat balance (Euler, 600 a minute).

    `begins`: how warm it is at first; None: in equilibrium.
    """
    out = np.empty(len(speed))
    state = float(speed[0]) if begins is None else begins
    for i in range(len(speed)):
        out[i] = state
        end = speed[min(i + 1, len(speed) - 1)]
        for k in range(600):
            now = speed[i] + (end - speed[i]) * (k + 0.5) / 600.0
            state += (now - state) * (MINUTE / 600.0) / tau
    return out


def growth(seed: int, truth: list[tuple[float, float, float | None]]) -> tuple[Model, Campaign]:
    """A spindle's nose read every minute for five hours; mm at 10,000 rpm, τ in s, at first."""
    rng = np.random.default_rng(seed)
    speed = np.repeat(rng.choice([0.0, 0.3, 0.6, 1.0], 12), 25)
    grown = sum(k * body(speed, tau, begins) for k, tau, begins in truth)
    text = """
format = "abbe-model/1"
[machine]
name = "mill"
structure = "w b X Y Z t"
[machine.signals.n]
unit = "rpm"
role = "speed"
"""
    text += "".join(f"[machine.axes.{a}]\ntravel = [0.0, 400.0]\n" for a in "XYZ")
    rows = ['# format = "abbe-campaign/1"', '# instrument = "probe"', "# [setups.z]"]
    rows += ['# free = ["zero"]', "time,setup,kind,X,Y,Z,ux,uy,uz,value,n"]
    for i, (n, e) in enumerate(zip(speed, np.broadcast_to(grown, len(speed)), strict=True)):
        value = 1e3 * e + rng.normal(0.0, 0.3)
        rows.append(f"{i * MINUTE},z,displacement,200,200,200,0,0,1,{value:.3f},{1e4 * n:.1f}")
    model = parse_model(TomlSource(text))
    return model, as_campaign("\n".join(rows) + "\n", model)


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
    found = reached(course)
    assert found["tau"] == pytest.approx(1800.0, rel=0.05)
    _, campaign = growth(3, [(0.03, 1800.0, 0.8)])
    first = campaign.conditions.signal("n")[0] / 1e4
    assert found["start"] == pytest.approx(0.03 * (0.8 - first), rel=0.05)


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
