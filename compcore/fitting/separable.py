"""Variable projection for effects' non-linear parameters (time constants, periods, moments).

For given non-linear parameters α everything else is linear, and the best χ² is known at once: the
other effects' columns are projected out once, and of each trial α only the few columns that depend
on it have to be made. What is minimised is ``‖y⊥ − P_{C⊥(α)} y⊥‖²`` over α alone (Golub and
Pereyra, SIAM J. Numer. Anal. 10 (1973) 413), from several starts.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import NonlinearParameter
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.linalg import svd

F64 = NDArray[np.float64]

_MOST_STARTS = 500
_REFINED = 3
"""So many of the best starts are refined; the best result is kept."""
_SEEN = 1e-4
"""A column of which the other effects leave less than this part is not seen at all."""
_ELEMENTS = 20_000_000
"""A larger design matrix is searched on a part of its rows; the fit then uses all."""


class Profile:
    """χ² as a function of the non-linear parameters alone, all linear ones fitted.

    Parameters
    ----------
    problem
        The problem; `theta` where it is linearised.
    """

    def __init__(self, problem: Problem, theta: F64) -> None:
        stride = 1 + problem.n * problem.layout.size // _ELEMENTS
        self.problem = (
            problem if stride == 1 else problem.part(np.arange(0, problem.n, stride), theta)
        )
        self.theta = theta
        layout = problem.layout
        self.index = list(layout.searched)
        self.parameters = list(layout.searched.values())
        self.terms = sorted({layout.unknowns[i].owner for i in self.index})
        began = np.concatenate([problem.start_index(t) for t in self.terms])
        own = np.concatenate([np.arange(layout.size)[layout.terms[t]] for t in self.terms])
        own = np.concatenate([own, began])
        others = np.setdiff1d(np.arange(layout.size), own)
        self._eliminator = self.problem.eliminator(theta)
        columns = self.problem.columns(theta)
        residual = self.problem.residual(theta)
        linear = np.concatenate([np.arange(layout.size)[layout.linear_of(t)] for t in self.terms])
        linear = np.concatenate([linear, began])
        residual += columns[:, linear] @ theta[linear]
        self._q = self._basis(columns[:, others], layout.scale[others])
        self._y = self._apart(residual)
        self._kept: dict[tuple[int, tuple[float, ...]], F64] = {}

    def _basis(self, columns: F64, scale: F64) -> F64:
        projected = self._eliminator.project(columns)
        factor = np.linalg.qr(projected, mode="r")
        d = Decomposition(np.asarray(factor), scale, self.problem.n)
        mixed = projected @ (scale[:, None] * d.determined / d.singular[: d.rank])
        return np.asarray(np.linalg.qr(mixed)[0])

    def _apart(self, columns: F64) -> F64:
        left = self._eliminator.project(columns)
        return np.asarray(left - self._q @ (self._q.T @ left))

    def _columns(self, term: int, values: dict[str, float]) -> F64:
        key = (term, tuple(values.values()))
        if key not in self._kept:
            if len(self._kept) > 64:
                self._kept.clear()
            effect = self.problem.model.effects[term]
            columns = np.hstack(
                [
                    self.problem.effect_columns(effect, values, self.theta),
                    self.problem.start_columns(term, values, self.theta),
                ]
            )
            size = np.linalg.norm(columns, axis=0)
            self._kept[key] = self._apart(columns / np.where(size > 0.0, size, 1.0))
        return self._kept[key]

    def residual(self, alpha: F64) -> F64:
        """Weighted residuals with everything linear fitted, shape (n,)."""
        theta = self.theta.copy()
        theta[self.index] = alpha
        layout = self.problem.layout
        stacked = np.hstack(
            [self._columns(t, layout.nonlinear_values(t, theta)) for t in self.terms]
        )
        u, s, _ = svd(stacked)
        u = u[:, s > _SEEN]
        return np.asarray(self._y - u @ (u.T @ self._y))

    def cost(self, alpha: F64) -> float:
        """χ² at the non-linear parameters α."""
        left = self.residual(alpha)
        return float(left @ left)


def search(problem: Problem, theta: F64, *, only: Collection[int] | None = None) -> F64:
    """θ with the best non-linear parameters, everything else as given.

    `only`: the terms whose parameters are searched everywhere, default all; those of the others
    are moved to the best place near where they stand.
    """
    profile = Profile(problem, theta)
    terms = [t for t in profile.terms if only is None or t in only]
    alpha = theta[profile.index]
    cost = np.inf
    for again in range(3 if terms else 0):
        for term in terms:
            alpha = _search_term(profile, alpha, term, 1 if again else _REFINED)
        now = profile.cost(alpha)
        if len(terms) == 1 or cost - now < 1e-3:
            break
        cost = now
    if len(profile.terms) > 1 or not terms:
        # each stands best beside the others; now all of them together
        alpha = _refine(profile, alpha, range(len(profile.parameters)))
    found = theta.copy()
    found[profile.index] = alpha
    return found


def _search_term(profile: Profile, alpha: F64, term: int, most: int) -> F64:
    """The best α found when one term's parameters start everywhere, the others where they are.

    `most`: so many of the best starts are refined.
    """
    owners = [profile.problem.layout.unknowns[i].owner for i in profile.index]
    mine = [k for k, owner in enumerate(owners) if owner == term]
    starts = _starts([profile.parameters[k] for k in mine])
    trials = []
    for start in [tuple(alpha[mine]), *starts]:
        trial = alpha.copy()
        trial[mine] = start
        trials.append((profile.cost(trial), trial))
    trials.sort(key=lambda pair: pair[0])
    refined = [_refine(profile, trial, mine) for _, trial in trials[:most]]
    return min(refined, key=profile.cost)


def _starts(parameters: Sequence[NonlinearParameter]) -> list[tuple[float, ...]]:
    """All combinations of starts, thinned evenly where they are too many."""
    each = [p.starts for p in parameters]
    while np.prod([len(s) for s in each]) > _MOST_STARTS:
        longest = max(range(len(each)), key=lambda k: len(each[k]))
        each[longest] = each[longest][::2]
    return list(itertools.product(*each))


def _refine(profile: Profile, alpha: F64, which: Iterable[int]) -> F64:
    """The nearest minimum of some parameters: steps searched, smooth ones by least squares."""
    which = list(which)
    for k in which:
        if not profile.parameters[k].smooth:
            alpha = _zoom(profile, alpha, k)
    smooth = [k for k in which if profile.parameters[k].smooth]
    if not smooth:
        return alpha
    low = np.array([profile.parameters[k].bounds[0] for k in smooth])
    high = np.array([profile.parameters[k].bounds[1] for k in smooth])
    # a quantity that may differ by decades is searched in its logarithm
    decades = (low > 0.0) & (high > 30.0 * np.maximum(low, 1e-300))

    def inside(x: F64) -> F64:
        full = alpha.copy()
        full[smooth] = np.clip(np.where(decades, np.exp(np.where(decades, x, 0.0)), x), low, high)
        return full

    def scaled(x: F64) -> F64:
        return np.where(decades, np.log(np.where(decades, x, 1.0)), x)

    begin = np.clip(alpha[smooth], low, high)

    def left(x: F64) -> F64:
        return profile.residual(inside(x))

    # half a second of import, for those that need it
    from scipy.optimize import least_squares

    found = least_squares(
        left,
        scaled(begin),
        bounds=(scaled(low), scaled(high)),
        x_scale=np.where(decades, 1.0, np.maximum(1e-3 * (high - low), 1e-12)),
        diff_step=[1e-6],
        # least squares over all unknowns goes on from here
        xtol=1e-5,
        ftol=1e-7,
        max_nfev=60,
    )
    best = inside(found.x)
    return best if profile.cost(best) <= profile.cost(alpha) else alpha


def _zoom(profile: Profile, alpha: F64, k: int) -> F64:
    """The best value of one parameter near where it stands, by ever finer grids."""
    parameter = profile.parameters[k]
    low, high = parameter.bounds
    around = sorted({low, high, *parameter.starts})
    right = int(np.searchsorted(around, alpha[k]))
    left_end = around[max(right - 1, 0)]
    right_end = around[min(right + 1, len(around) - 1)]
    smallest = 1e-9 * (high - low)
    while right_end - left_end > smallest:
        grid = np.linspace(left_end, right_end, 9)
        costs = [_moved(profile, alpha, k, value - alpha[k]) for value in grid]
        flat = np.flatnonzero(np.array(costs) <= min(costs) + 1e-9)
        alpha = alpha.copy()
        alpha[k] = float(grid[flat].mean())
        if flat[-1] - flat[0] >= 6:
            break
        left_end = float(grid[max(flat[0] - 1, 0)])
        right_end = float(grid[min(flat[-1] + 1, 8)])
    return alpha


def step_widths(problem: Problem, theta: F64) -> dict[int, float]:
    """Standard uncertainties of parameters without derivative (a step's moment): index → sd.

    Index in θ → half the width of the range in which χ² rises by less than 1; the reading between
    two rows is never finer than their distance.
    """
    layout = problem.layout
    stepped = [i for i, p in layout.searched.items() if not p.smooth]
    if not stepped:
        return {}
    profile = Profile(problem, theta)
    alpha = theta[profile.index]
    best = profile.cost(alpha)
    found = {}
    for i in stepped:
        k = profile.index.index(i)
        low, high = profile.parameters[k].bounds
        ends = []
        for sign, limit in ((-1.0, low), (1.0, high)):
            inside, outside = 0.0, 1e-9 * (high - low)
            reach = abs(limit - alpha[k])
            while outside < reach and _moved(profile, alpha, k, sign * outside) < best + 1.0:
                inside, outside = outside, 2.0 * outside
            for _ in range(8):
                middle = 0.5 * (inside + outside)
                if _moved(profile, alpha, k, sign * middle) < best + 1.0:
                    inside = middle
                else:
                    outside = middle
            ends.append(min(outside, reach))
        found[i] = 0.5 * (ends[0] + ends[1])
    return found


def _moved(profile: Profile, alpha: F64, k: int, by: float) -> float:
    """χ² with one non-linear parameter moved."""
    trial = alpha.copy()
    trial[k] += by
    return profile.cost(trial)
