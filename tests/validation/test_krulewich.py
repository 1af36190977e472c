"""Krulewich's experiment: diagonals that were not measured, from distances alone."""

import numpy as np
import pytest

from benchmarks.sources import krulewich


def test_diagonals_within_two_micrometres_and_nineteen_twentieths_explained() -> None:
    experiment, result, diagonals = krulewich.run(2, "polynomial")
    assert experiment.campaign.n > 3000
    assert experiment.coverage == 1.0
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.1)
    assert diagonals.before.max() > 25e-3
    assert diagonals.after.max() < 2e-3
    assert diagonals.explained > 0.95
    assert diagonals.inside > 0.8


def test_splines_go_on_where_polynomials_end() -> None:
    _, _, polynomial = krulewich.run(1, "polynomial", truth="wavy")
    _, result, spline = krulewich.run(1, "spline:7", truth="wavy")
    assert polynomial.after.max() > 4e-3
    assert spline.after.max() < 2e-3
    assert spline.explained > 0.95
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.1)


def test_knots_that_are_found_need_fewer_coefficients() -> None:
    _, result, found = krulewich.run(2, "spline:auto", truth="wavy")
    assert found.after.max() < 2.5e-3
    assert found.explained > 0.93
    assert found.inside > 0.85
    assert result.problem.layout.model_size < len(result.knots) * 7
    assert all(sum(k.probability.values()) == pytest.approx(1.0) for k in result.knots)


def test_a_fourth_base_shows_the_instruments_bias() -> None:
    bias = 5e-3
    _, result, diagonals = krulewich.run(1, "polynomial", bases=4, bias=bias)
    found = result.model.terms[-1].values["bias"]
    assert found.sd is not None
    assert found.sd < 0.4e-3
    assert abs(found.value - bias) < 3.0 * found.sd
    assert diagonals.after.max() < 2e-3


def test_what_no_tool_offset_shows_is_reported() -> None:
    _, result, _ = krulewich.run(2, "polynomial")
    # tools stand along Z: Y's roll about Z, where the spindle sits, has no lever
    (unknown,) = [u for u in result.undetermined if not u.convention]
    assert unknown.text.startswith("E_CY: this campaign does not show it")
    lengths = {n: result.theta[w] for n, (w, _) in result.problem.layout.tools.items()}
    apart = np.diff([offset[2] for offset in lengths.values()])[0]
    true = krulewich.TOOLS["T2"][2] - krulewich.TOOLS["T1"][2]
    assert apart == pytest.approx(true, abs=1e-3)
