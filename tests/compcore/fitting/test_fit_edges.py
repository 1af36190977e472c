"""Campaigns and models at the edge: nothing to fit, too few rows, nothing that shows anything."""

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.errors import FitError, InputError
from abbe.compcore.fitting.fit import fit
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import BASES, DIRECTIONS, GEOMETRY, bridge, model


def some_rows(n: int, u: str = "X", **keys: object):
    rows = Rows(("X", "Y", "Z"))
    place = {"X": np.linspace(0.0, 700.0, n), "Y": 100.0, "Z": -100.0}
    value = 1e-3 * np.arange(n)
    rows.add("s", Kind.DISPLACEMENT, place, value, 1e-3, u=DIRECTIONS[u], **keys)
    return rows.campaign("few")


def test_no_effects_leave_the_measurements_less_their_zeros() -> None:
    comparison = compare(model(bridge()), some_rows(5))
    assert comparison.residual == pytest.approx(1e-3 * (np.arange(5) - 2.0))
    result = fit(model(bridge()), some_rows(5))
    assert result.residual == pytest.approx(comparison.residual)
    assert result.dof == 4


@pytest.mark.parametrize("n", [1, 2, 3])
def test_fewer_rows_than_parameters_fit_without_complaint(n: int) -> None:
    result = fit(model(bridge(), *GEOMETRY), some_rows(n))
    assert result.dof == 0
    assert np.abs(result.residual).max() < 1e-9
    values = [v for t in result.model.terms for v in t.values.values()]
    assert np.isfinite([v.value for v in values]).all()
    assert np.isfinite([v.sd for v in values]).all()
    assert result.undetermined


def test_effects_that_nothing_shows_stay_at_nothing_and_are_reported() -> None:
    machine = bridge("T")
    wanted = model(machine, "scale_expansion axis=Z signals=T", "positioning axis=X")
    result = fit(wanted, some_rows(20, signals={"T": 21.0}))
    alpha = result.model.terms[0].values["alpha"]
    assert alpha.value == pytest.approx(0.0, abs=1e-15)
    assert alpha.sd == pytest.approx(15e-6)
    (combination,) = [u for u in result.undetermined if not u.convention]
    assert combination.effects == ("scale_expansion axis=Z signals=T",)


def test_an_empty_campaign_is_refused() -> None:
    empty = some_rows(5).rows(np.zeros(5, dtype=bool))
    with pytest.raises(FitError, match="no rows"):
        fit(model(bridge(), "scale axis=X"), empty)
    with pytest.raises(FitError, match="no rows"):
        compare(model(bridge()), empty)


def test_a_base_point_without_coordinates_is_named() -> None:
    rows = Rows(("X", "Y", "Z"))
    place = {"X": np.linspace(0.0, 700.0, 5), "Y": 100.0, "Z": -100.0}
    rows.add("d", Kind.DISTANCE, place, np.full(5, 500.0), 1e-3, free=(), base="B9")
    with pytest.raises(InputError, match="B9"):
        fit(model(bridge(), "scale axis=X"), rows.campaign("d", bases=BASES))


def test_identical_rows_and_perfect_values_do_no_harm() -> None:
    rows = Rows(("X", "Y", "Z"))
    place = {"X": 350.0, "Y": 100.0, "Z": -100.0}
    rows.add("m", Kind.DISPLACEMENT, place, np.zeros(30), 1e-3, u=DIRECTIONS["X"])
    result = fit(model(bridge(), *GEOMETRY), rows.campaign("m"), robust=True)
    assert result.chi2 == pytest.approx(0.0, abs=1e-12)
    assert not result.outliers


def test_a_million_micrometres_do_not_upset_the_rank() -> None:
    wanted = model(bridge(), "positioning axis=X shape=polynomial:3")
    far = some_rows(20)
    x = far.conditions.position("X")
    from dataclasses import replace

    wrong = replace(far, value=50.0 * (x / 700.0) ** 2)  # a wrong unit: 50 mm of error
    result = fit(wanted, wrong)
    assert np.abs(result.residual).max() < 1e-9
    assert result.decomposition.rank == 3
