"""A formula that is offered says what its description says, and holds in warmer hours, too."""

from __future__ import annotations

import re

import numpy as np

from abbe.compcore.diagnosis.screening.projection.basis import Basis, orthonormal
from abbe.compcore.diagnosis.uncatalogued.patterns.products import surfaces
from abbe.compcore.diagnosis.uncatalogued.patterns.variables import PatternVariable, term_of
from abbe.compcore.diagnosis.uncatalogued.short_formula import shortened
from abbe.compcore.fitting.design.nuisance import Eliminator
from abbe.compcore.machine.error_motion import FUNCTIONAL_POINT, ErrorMotion

N = 1500


def offered(seed: int) -> tuple[str, ...]:
    """The formula of ``exp(x)·(T − T₀)`` in noise, x ± 1 along an axis, T through a warm day."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, N)
    warm = np.sin(np.linspace(-1.5, 1.5, N)) + 0.02 * rng.normal(size=N)
    warm /= np.abs(warm).max()
    quantities = [
        PatternVariable("X", x, 500.0, 500.0, "mm", "position"),
        PatternVariable("T", warm, 21.0, 0.8, "degC", "signal"),
    ]
    left = np.exp(x) * warm + rng.normal(0.0, 1.0, N)
    basis = Basis(np.zeros((N, 0)), left, Eliminator((), np.zeros(0)), np.zeros((N, 0)))
    on = ErrorMotion(FUNCTIONAL_POINT, "X")
    form = "proportional to T, by a smooth function of X"
    (pattern,) = [p for p in surfaces(quantities, on) if p.form == form]
    span = orthonormal(pattern.basis, np.linalg.norm(pattern.basis, axis=0))
    drop = float(np.sum((span.T @ left) ** 2))
    return shortened(basis, pattern, quantities, np.ones(N), drop).terms


def test_what_is_proportional_to_a_temperature_is_so_in_each_term() -> None:
    for seed in range(20):
        terms = offered(seed)
        assert terms, seed
        for term in terms:
            assert len(re.findall(r"\(T - 21\)(?!\*\*)", term)) == 1, (seed, terms)


def test_a_coefficient_is_one_for_the_unit_that_it_is_printed_in() -> None:
    """µm/K are not µm for each 0.8 K: nothing is divided by a range."""
    quantities = [
        PatternVariable("X", np.zeros(1), 0.0, 500.0, "mm", "position"),
        PatternVariable("T", np.zeros(1), 21.0, 0.8, "degC", "signal"),
        PatternVariable("Y_dir", np.ones(1), 0.0, 1.0, "", "direction"),
    ]
    assert term_of(quantities) == "X*(T - 21)*Y_dir"
    assert term_of([quantities[1]] * 2) == "(T - 21)**2"
