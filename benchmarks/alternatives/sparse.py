"""A sparse regression over a library of terms: the Lasso, its penalty by cross-validation."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import lasso_path
from sklearn.model_selection import GroupKFold

from abbe.compcore.fitting.fit import FitResult
from benchmarks.hidden.judging.inputs import ORDER, Inputs, Learnt

F64 = NDArray[np.float64]

FOLDS = 3
ALPHAS = 30
LEAST = 0.01
"""Least penalty, part of the one from which on nothing is kept."""
PATIENCE = 8
"""Penalties without a better prediction after which no smaller one is tried."""

SETTINGS = (
    f"*Lasso*: at most {ALPHAS} penalties, the best of them by {FOLDS} folds that leave set-ups "
    f"out whole, over all products of up to {ORDER} recorded quantities (tools apart) times each "
    "component of the measured direction"
)


def lasso(result: FitResult, seen: Inputs, unseen: Inputs) -> Learnt:
    """Sparse regression over the library; what model and set-ups imitate is taken out first."""
    terms, library = seen.library
    library = library * seen.rows[:, None]
    columns = result.residualise(library * result.problem.weight[:, None])
    sizes = np.linalg.norm(columns, axis=0)
    usable = np.flatnonzero(sizes > 1e-6 * sizes.max())
    unit = np.sqrt(len(columns)) / sizes[usable]
    campaign = result.problem.campaign
    setups = (
        np.zeros(campaign.n) if campaign.conditions.setup is None else campaign.conditions.setup
    )
    coefficients = np.zeros(len(terms))
    coefficients[usable] = unit * cross_validated(
        columns[:, usable] * unit, result.weighted, setups
    )
    order = np.argsort(-np.abs(coefficients) * sizes)
    return Learnt(
        library @ coefficients,
        unseen.library[1] @ coefficients * unseen.rows,
        tuple(terms[i] for i in order if coefficients[i]),
    )


def cross_validated(columns: F64, values: F64, setups: NDArray[np.generic]) -> F64:
    """Coefficients at the penalty that best predicts set-ups that were left out, (p,).

    Parameters
    ----------
    columns, values
        (n, p), of norm √n each, and (n,).
    setups
        Set-up of each row, (n,).
    """
    names = np.unique(setups, return_inverse=True)[1]
    tests = [test for _, test in GroupKFold(FOLDS).split(columns, groups=names)]
    # products are summed fold by fold, so that all paths together cost one
    grams = [columns[test].T @ columns[test] for test in tests]
    moments = [columns[test].T @ values[test] for test in tests]
    gram, moment = np.sum(grams, axis=0), np.sum(moments, axis=0)
    trains = [np.setdiff1d(np.arange(len(values)), test) for test in tests]
    paths = [
        _Path(columns[train], values[train], gram - own, moment - part)
        for train, own, part in zip(trains, grams, moments, strict=True)
    ]
    alphas = float(np.abs(moment).max()) / len(values) * np.geomspace(1.0, LEAST, ALPHAS)
    wrong: list[float] = []
    for alpha in alphas:
        left = [
            values[test] - columns[test] @ path.at(alpha)
            for test, path in zip(tests, paths, strict=True)
        ]
        wrong.append(float(np.mean([np.mean(r**2) for r in left])))
        if len(wrong) - 1 - int(np.argmin(wrong)) >= PATIENCE:
            break
    whole = _Path(columns, values, gram, moment)
    for alpha in alphas[: int(np.argmin(wrong)) + 1]:
        whole.at(alpha)
    return whole.coefficients


class _Path:
    """The Lasso's coefficients at falling penalties, each found from those before."""

    def __init__(self, columns: F64, values: F64, gram: F64, moment: F64) -> None:
        self.coefficients = np.zeros(columns.shape[1])
        self._given = np.asfortranarray(columns), values
        self._gram, self._moment = gram, moment

    def at(self, alpha: float) -> F64:
        """The coefficients at the next penalty, (p,)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            _, found, _ = lasso_path(
                *self._given,
                alphas=[alpha],
                precompute=self._gram,
                Xy=self._moment,
                coef_init=self.coefficients,
                max_iter=300,
                tol=1e-3,
                check_input=False,
            )
        self.coefficients = np.asarray(found[:, 0])
        return self.coefficients
