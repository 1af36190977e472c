"""Chances of normal, χ² and F variables, against SciPy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special, stats

from abbe.compcore.distributions import (
    chi2_beyond,
    chi2_limit,
    f_beyond,
    f_limit,
    log_f_beyond,
    normal_limit,
    signed_rank_beyond,
)

FREEDOMS = (0.7, 1, 2, 3, 7.5, 20, 150, 2000, 1e5)


@pytest.mark.parametrize("dof", FREEDOMS)
@pytest.mark.parametrize("ratio", [1e-3, 0.3, 0.9, 0.999, 1.0, 1.01, 1.5, 5.0])
def test_tail_of_chi2(dof: float, ratio: float) -> None:
    wanted = float(special.chdtrc(dof, ratio * dof))
    assert chi2_beyond(ratio * dof, dof) == pytest.approx(wanted, rel=1e-10, abs=1e-290)


@pytest.mark.parametrize("dof", FREEDOMS)
@pytest.mark.parametrize("k", [1, 2, 5, 40, 300.5])
@pytest.mark.parametrize("f", [1e-6, 0.2, 0.99, 1.0, 1.3, 4.0, 50.0])
def test_tail_of_f(k: float, dof: float, f: float) -> None:
    wanted = float(special.fdtrc(k, dof, f))
    assert f_beyond(f, k, dof) == pytest.approx(wanted, rel=1e-10, abs=1e-290)


@pytest.mark.parametrize("f", [0.2, 0.999, 1.0, 1.0005, 4.0, 30.0])
def test_tails_with_ten_million_degrees_of_freedom(f: float) -> None:
    dof = 1e7
    assert f_beyond(f, 3, dof) == pytest.approx(float(special.fdtrc(3, dof, f)), rel=2e-8)
    near = 1.0 + 1e-3 * (f - 1.0) / 29.0
    wanted = float(special.chdtrc(dof, near * dof))
    assert chi2_beyond(near * dof, dof) == pytest.approx(wanted, rel=2e-8)


def test_the_logarithm_goes_on_where_the_chance_is_no_number_any_more() -> None:
    assert special.fdtrc(1, 2000, 5000.0) == 0.0
    # with many degrees of freedom the leading term of the tail is all of it
    x = 2000 / (2000 + 5000.0)
    leading = (
        1000 * math.log(x) + 0.5 * math.log(1 - x) - math.log(1000) - special.betaln(1000, 0.5)
    )
    assert log_f_beyond(5000.0, 1, 2000) == pytest.approx(leading, rel=1e-3)
    assert log_f_beyond(5000.0, 1, 2000) < log_f_beyond(4999.0, 1, 2000) < -600


def test_nothing_is_certain() -> None:
    assert chi2_beyond(0.0, 5) == f_beyond(0.0, 3, 5) == 1.0
    assert chi2_beyond(math.inf, 5) == f_beyond(math.inf, 3, 5) == 0.0


@pytest.mark.parametrize("nothing", [0.0, -1.0, math.nan])
def test_without_degrees_of_freedom_nothing_is_known(nothing: float) -> None:
    assert math.isnan(chi2_beyond(1.0, nothing))
    assert math.isnan(f_beyond(1.0, nothing, 5))
    assert math.isnan(f_beyond(1.0, 5, nothing))
    assert math.isnan(chi2_beyond(math.nan, 5))
    assert math.isnan(f_beyond(math.nan, 5, 5))


@pytest.mark.parametrize("dof", FREEDOMS)
@pytest.mark.parametrize("chance", [0.975, 0.5, 0.025, 1e-4])
def test_limits(dof: float, chance: float) -> None:
    assert chi2_limit(chance, dof) == pytest.approx(stats.chi2.isf(chance, dof), rel=1e-10)
    assert f_limit(chance, 4, dof) == pytest.approx(stats.f.isf(chance, 4, dof), rel=1e-10)


@pytest.mark.parametrize("chance", [0.4, 0.025, 1e-3, 5e-9, 5e-15])
def test_limit_of_a_normal_variable(chance: float) -> None:
    assert normal_limit(chance) == pytest.approx(stats.norm.isf(chance), rel=1e-13)


@pytest.mark.parametrize("n", [1, 2, 5, 12, 20])
def test_signed_ranks(n: int) -> None:
    values = np.random.default_rng(n).normal(0.3, 1.0, n)
    wanted = stats.wilcoxon(values, alternative="greater", method="exact").pvalue
    assert signed_rank_beyond(values) == pytest.approx(float(wanted), rel=1e-12)
    assert signed_rank_beyond(np.append(values, 0.0)) == signed_rank_beyond(values)
