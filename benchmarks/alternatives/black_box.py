"""What a user would do without a catalogue: two black boxes.

They learn what a fitted model leaves in each measured direction, from everything that was recorded.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from abbe.compcore.fitting.fit import FitResult
from benchmarks.hidden.judging.inputs import Inputs, Learnt

F64 = NDArray[np.float64]

SUBSAMPLE = 300
"""Rows from which the Gaussian process learns its length scales; it then takes all rows."""
STEPS = 20
"""Most steps of its search for them."""
MOST_ROWS = 2500
"""Most rows that it takes."""
TREES = 400
RATE = 0.05

SETTINGS = (
    f"*Gaussian process*: RBF with one length scale for each input, learnt from {SUBSAMPLE} rows "
    f"in at most {STEPS} steps, white noise; then all rows, at most {MOST_ROWS}. *Boosting*: "
    f"histogram gradient boosting, rate {RATE}, at most {TREES} trees, stopped where a tenth of "
    f"the rows left out no longer improves."
)


def gaussian_process(result: FitResult, seen: Inputs, unseen: Inputs) -> Learnt:
    """A Gaussian process with a length scale for each input."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    features, residual = seen.features[seen.rows], result.residual[seen.rows]
    size = float(residual.std())
    kernel = ConstantKernel(0.5) * RBF(np.full(features.shape[1], 3.0), (0.3, 100.0))
    kernel += WhiteKernel(0.5, (0.01, 2.0))
    order = np.random.default_rng(0).permutation(len(residual))
    few, most = order[:SUBSAMPLE], order[:MOST_ROWS]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        learnt = GaussianProcessRegressor(kernel, optimizer=_search)
        learnt.fit(features[few], residual[few] / size)
    whole = GaussianProcessRegressor(learnt.kernel_, optimizer=None)
    whole.fit(features[most], residual[most] / size)
    return _placed(seen, unseen, lambda at: size * whole.predict(at))


def _search(loss: Callable[[F64], tuple[float, F64]], start: F64, bounds: F64) -> tuple[F64, float]:
    best = optimize.minimize(
        loss, start, method="L-BFGS-B", jac=True, bounds=bounds, options={"maxiter": STEPS}
    )
    return best.x, best.fun


def boosting(result: FitResult, seen: Inputs, unseen: Inputs) -> Learnt:
    """Gradient boosting on the same inputs."""
    from sklearn.ensemble import HistGradientBoostingRegressor

    trees = HistGradientBoostingRegressor(
        learning_rate=RATE, max_iter=TREES, early_stopping=True, random_state=0
    )
    trees.fit(seen.features[seen.rows], result.residual[seen.rows])
    return _placed(seen, unseen, trees.predict)


def _placed(seen: Inputs, unseen: Inputs, predict: Callable[[F64], F64]) -> Learnt:
    """Predictions at the rows that measure lengths, 0 at the others."""
    here, there = np.zeros(len(seen.rows)), np.zeros(len(unseen.rows))
    here[seen.rows] = predict(seen.features[seen.rows])
    there[unseen.rows] = predict(unseen.features[unseen.rows])
    return Learnt(here, there)
