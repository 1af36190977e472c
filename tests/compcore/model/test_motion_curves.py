"""Curves of error motions, error maps, superposition and the rigid-body test on small machines."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.design.superposition import uncompensated
from abbe.compcore.fitting.fit import fit
from abbe.compcore.fitting.rigid_body import rigid_body_test
from abbe.compcore.model.error_map import error_map, worst_pair
from abbe.compcore.model.motion_curves import motion_curves
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    BASES,
    GEOMETRY,
    TOOLS,
    bridge,
    distance_rows,
    fitted,
    mill,
    model,
    plane_rows,
    random_theta,
    with_truth,
)


def measured(seed: int = 0):
    rng = np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    wanted = model(bridge(), *GEOMETRY)
    campaign = rows.campaign("plane")
    theta = random_theta(wanted, campaign, rng)
    return wanted, with_truth(wanted, campaign, theta, rng)


def test_curves_are_what_the_effects_say_with_the_models_own_uncertainty() -> None:
    wanted, campaign = measured()
    result = fit(wanted, campaign)
    curves = {str(c.error_motion): c for c in motion_curves(result.model, "X")}
    assert list(curves) == ["E_XX", "E_YX", "E_CX"]
    positioning = result.model.terms[0]
    c = [v.value for v in positioning.values.values()]
    x = curves["E_XX"].position / 350.0 - 1.0
    assert curves["E_XX"].value == pytest.approx(np.polynomial.legendre.legval(x, c), abs=1e-12)
    assert curves["E_XX"].sd.max() < 1e-3
    bare = replace(result.model, covariance=None)
    assert motion_curves(bare, "X")[0].sd.max() == 0.0


def test_the_worst_pair_of_a_pure_squareness_is_a_diagonal() -> None:
    skew = fitted(model(bridge(), "squareness axes=Y,X"), {"squareness axes=Y,X": 30e-6})
    found = error_map(skew, ("X", "Y"), {"Z": -100.0})
    assert sorted(found.worst["X"]) == [0.0, 700.0]
    assert sorted(found.worst["Y"]) == [0.0, 900.0]
    # a diagonal of a right angle that is off by s errs by s·a·b / √(a² + b²)
    expected = 30e-6 * 700.0 * 900.0 / np.hypot(700.0, 900.0)
    assert abs(found.worst_error) == pytest.approx(expected, rel=1e-3)


def test_a_rigid_displacement_has_no_worst_pair() -> None:
    point = np.random.default_rng(0).uniform(0.0, 500.0, (20, 3))
    error = np.array([0.1, 0.2, 0.3]) + np.cross(np.array([1e-5, 2e-5, -1e-5]), point)
    assert abs(worst_pair(point, error)[2]) < 1e-12


def test_a_map_needs_two_linear_axes() -> None:
    with pytest.raises(InputError, match="no such axis"):
        error_map(model(bridge()), ("X", "W"), {})


@pytest.mark.parametrize("kind", ["lines", "distances"])
def test_an_active_compensation_is_put_back(kind: str) -> None:
    rng = np.random.default_rng(3)
    rows = Rows(("X", "Y", "Z"))
    if kind == "lines":
        plane_rows(rows)
        truth = model(bridge(), *GEOMETRY)
        campaign = rows.campaign("c")
    else:
        distance_rows(rows, rng)
        truth = model(mill(), "positioning axis=X shape=polynomial:3", "squareness axes=X,Y")
        tools = {n: replace(t, free=()) for n, t in TOOLS.items()}
        campaign = rows.campaign("c", bases=BASES, tools=tools)
    theta = random_theta(truth, campaign, rng)
    bare = with_truth(truth, campaign, theta)
    layout = fit(truth, bare).problem.layout
    active = truth.with_values(layout.values(0.7 * theta, np.zeros(layout.size)))
    left = truth.with_values(layout.values(0.3 * theta, np.zeros(layout.size)))
    # the compensated machine errs by the rest; its angles are the bare machine's
    shown = with_truth(
        left, campaign, np.where(np.arange(layout.size) < layout.model_size, 0.3, 1.0) * theta
    )
    angles = campaign.kind == Kind.ROTATION
    shown = replace(shown, value=np.where(angles, bare.value, shown.value))
    assert np.abs(shown.value - bare.value).max() > 5e-3
    # distances to first order: bases are known to a millimetre, errors some tenths
    assert uncompensated(shown, active).value == pytest.approx(bare.value, abs=3e-5)


def test_flexing_is_distinguished_from_levers() -> None:
    wanted, campaign = measured(5)
    sound = rigid_body_test(fit(wanted, campaign))
    assert sound[0].adjusted > 0.01
    c = campaign.conditions
    x, y = c.position("X") / 350.0 - 1.0, c.position("Y") / 450.0 - 1.0
    # X's straightness in Y bows more where Y stands further out
    flexed = campaign.value + 2e-3 * (1.0 - x**2) * y * (c.u[:, 1] > 0.99) * (
        campaign.kind == Kind.DISPLACEMENT
    )
    worst = rigid_body_test(fit(wanted, replace(campaign, value=flexed)))[0]
    assert "E_YX on Y" in {f"{worst.motion} on {worst.by}", *worst.alike}
    assert worst.adjusted < 1e-6


def test_compare_takes_the_active_compensation_too() -> None:
    wanted, campaign = measured(6)
    result = fit(wanted, campaign)
    rest = compare(result.model, uncompensated(campaign, result.model)).lengths.rms
    assert rest > 3.0 * compare(result.model, campaign).lengths.rms
