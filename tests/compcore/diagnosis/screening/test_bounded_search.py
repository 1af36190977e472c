"""Brent's search between bounds takes SciPy's steps."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from scipy import optimize

from abbe.compcore.diagnosis.screening.bounded_search import least


@pytest.mark.parametrize(
    "function",
    [
        lambda x: (x - 0.7) ** 2,
        lambda x: math.cos(3.0 * x) + 0.1 * x,
        lambda x: abs(x - 1.9) ** 0.5,
        lambda x: x,
        lambda x: -x,
        lambda x: 1.0,
    ],
)
@pytest.mark.parametrize("bounds", [(-1.0, 2.0), (0.0, 1e-3), (1e3, 1e5)])
def test_the_same_place_as_scipy(
    function: Callable[[float], float], bounds: tuple[float, float]
) -> None:
    within = 1e-3 * (bounds[1] - bounds[0])
    tried: list[float] = []

    def counted(x: float) -> float:
        tried.append(x)
        return function(x)

    wanted = optimize.minimize_scalar(
        function, bounds=bounds, method="bounded", options={"xatol": within}
    )
    assert least(counted, bounds, within) == (wanted.x, wanted.fun)
    assert len(tried) == wanted.nfev
    assert all(bounds[0] <= x <= bounds[1] for x in tried)
