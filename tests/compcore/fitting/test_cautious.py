"""Cautious values: lines that nobody measured, of an exact machine, are better than nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.effects.registry import make_effect
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.drivers.simulated.bridge.machine import make_bridge
from tests.support.drivers.measured_bridge import bridge, measured_by, on_unseen_lines


@pytest.mark.parametrize("instrument", ["ball-bar", "step-gauge"])
def test_what_nobody_measured_is_not_extrapolated(instrument: str) -> None:
    plain = measured_by(instrument, 1.0)
    machine = make_bridge(1)
    fitted = fit(plain.model, plain.campaign(machine, 1))
    nothing = on_unseen_lines(machine, None)
    assert on_unseen_lines(machine, fitted.model) > nothing
    careful = cautiously(fitted)
    assert on_unseen_lines(machine, careful.model) < nothing
    # it fits what was measured as well, within its noise
    assert careful.chi2_per_dof < 1.1 * max(fitted.chi2_per_dof, 1.0)
    assert careful.determined == fitted.determined
    assert careful.caution is not None
    assert "held near 0" in next(careful.caution.words())
    if instrument == "step-gauge":
        # along axes alone a roll does nothing
        assert "angular axis=X about=X shape=spline:11" in careful.caution.hardly


def test_values_are_those_of_bayes() -> None:
    """Against normal equations written here: (AᵀA + S⁻²)⁻¹ Aᵀy, S as it was found."""
    machine = replace(bridge(), signals={})
    effects = [
        make_effect("positioning", {"axis": "X", "shape": "spline:8"}),
        make_effect("squareness", {"axes": ["Y", "X"]}),
    ]
    model = Model(machine).with_effects(*effects)
    plain = measured_by("laser", 2.0, model)
    campaign = plain.campaign(make_bridge(1), 1)
    fitted = fit(model, campaign)
    careful = cautiously(fitted)
    problem = fitted.problem
    assert careful.caution is not None
    # a curve in long waves (Matérn, ν = 3/2, 0.15 of the travel, a fifth by itself) and a slope,
    # which is expected as the squareness is; where a cubic spline's coefficients stand: Greville
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, 6), np.ones(3)])
    place = np.array([knots[i + 1 : i + 4].mean() for i in range(8)])
    apart = np.sqrt(3.0) * np.abs(place[:, None] - place) / 0.15
    wave = 0.8 * (1.0 + apart) * np.exp(-apart) + 0.2 * np.eye(8)
    low, high = machine.axes["X"].travel
    line = 1e-3 * (high - low) * (place - 0.5)
    curve, angle = (careful.caution.expected[k] for k in ("positioning", "squareness"))
    scale = problem.layout.scale
    expected = np.zeros((9, 9))
    expected[:8, :8] = (curve * scale[0]) ** 2 * wave + angle**2 * np.outer(line, line)
    expected[8, 8] = (angle * scale[8]) ** 2
    zero = np.zeros(9)
    eliminator = problem.eliminator(zero)
    a = eliminator.project(problem.columns(zero))
    y = eliminator.project(campaign.value * problem.weight)
    # χ² is far above 1 here, as the model has two causes of some twenty: of each set-up the
    # uncertainties are scaled by what its own readings leave over
    hat = a @ np.linalg.pinv(a)
    left = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
    every = fitted.chi2_per_dof
    of = campaign.conditions.setup
    for name in campaign.setups:
        rows = of == name
        # one zero a set-up, as many coefficients as its rows feel
        dof = rows.sum() - 1.0 - np.trace(hat[np.ix_(rows, rows)])
        spread = max(1.0, ((left[rows] ** 2).sum() + 3.0 * every) / (dof + 3.0))
        a[rows] /= np.sqrt(spread)
        y[rows] /= np.sqrt(spread)
    inverse = np.linalg.inv(a.T @ a + np.linalg.inv(expected))
    values = inverse @ (a.T @ y)
    found = [v.value for term in careful.model.terms for v in term.values.values()]
    assert found == pytest.approx(values.tolist(), abs=1e-9, rel=1e-6)


def test_an_axis_that_bends_does_not_hold_the_others_near_nothing() -> None:
    """By one figure for all set-ups the slope of Z was 1.16 of 2.47 µm/half travel."""
    machine = replace(bridge(), signals={})
    keys = ({"axis": a, "shape": "polynomial:1"} for a in "XYZ")
    model = Model(machine).with_effects(*(make_effect("positioning", k) for k in keys))
    campaign = measured_by("laser", 2.0, model).campaign(make_bridge(1), 1)
    x = campaign.conditions.position("X")
    assert campaign.conditions.u is not None
    bent = 0.1 * (x / 350.0 - 1.0) ** 2 * campaign.conditions.u[:, 0]
    fitted = fit(model, replace(campaign, value=campaign.value + bent))
    careful = cautiously(fitted)
    assert careful.chi2_per_dof > 100.0  # what is left over is judged by what is stated
    least, held = (r.model.terms[2].values["c1"].value for r in (fitted, careful))
    assert held == pytest.approx(least, rel=0.2)


def test_effects_by_temperature_are_not_expected_near_nothing() -> None:
    machine = replace(bridge(), signals={})
    plain = measured_by("laser", 1.0, start_model(machine, StartOptions(positioning_only=True)))
    campaign = plain.campaign(make_bridge(1), 1)
    warm = {name: np.linspace(19.0, 22.0, campaign.n) for name in ("T_x1", "T_x2")}
    measured = replace(campaign, conditions=replace(campaign.conditions, signals=warm))
    model = Model(bridge()).with_effects(
        make_effect("scale_expansion", {"axis": "X", "signals": ["T_x1", "T_x2"]})
    )
    fitted = fit(model, measured)
    assert cautiously(fitted) is fitted
