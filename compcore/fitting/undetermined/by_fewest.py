"""Null directions of a campaign, each by the fewest effects that can make it."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.linalg import svd

F64 = NDArray[np.float64]

_LEAST = 1e-3
"""Smaller shares of a direction are not worth a name."""
_MOST_COMBINED = 4


def by_fewest(problem: Problem, directions: F64, whole: float) -> list[tuple[list[int], F64]]:
    """Null directions of a campaign, each with the fewest effects that can make it.

    Parameters
    ----------
    problem
        What was fitted: which unknowns belong to which effect.
    directions
        The null directions, orthonormal columns, shape (m, k) for m unknowns.
    whole
        A direction belongs to some effects when less than this part of its square lies elsewhere.

    Returns
    -------
    For each, the effects by their place in the model (−1: base points, −2: tools, −3: how warm
    bodies were when a run began) and the direction, shape (m, 1).
    """
    groups = _groups(problem)
    parts = {t: directions[i] for t, i in groups.items()}
    present = {t: part for t, part in parts.items() if float(np.sum(part**2)) > _LEAST**2}
    found: list[tuple[list[int], F64]] = []
    for family in _families(present, whole):
        inside = np.sum([present[t].T @ present[t] for t in family], axis=0)
        values, vectors = np.linalg.eigh(inside)
        own = vectors[:, values > 0.5]
        found += [
            (terms, directions @ (own @ way))
            for terms, way in _fewest({t: present[t] @ own for t in family}, whole)
        ]
    order = {t: place for place, t in enumerate(present)}
    return sorted(found, key=lambda each: (len(each[0]), [order[t] for t in each[0]]))


def _families(parts: dict[int, F64], whole: float) -> list[list[int]]:
    """Terms that share null directions, directly or through others: no direction lies in two."""
    least = whole / max(1, len(parts)) ** 2
    families: list[list[int]] = []
    for term, part in parts.items():
        bound = [
            family
            for family in families
            if any(float(np.sum((part @ parts[t].T) ** 2)) > least for t in family)
        ]
        families = [family for family in families if family not in bound]
        families.append(sorted(t for family in [*bound, [term]] for t in family))
    order = list(parts)
    return sorted(families, key=lambda family: min(order.index(t) for t in family))


def _fewest(parts: dict[int, F64], whole: float) -> list[tuple[list[int], F64]]:
    """Of one family: null directions by the fewest terms, (terms, (k, 1)); `parts`: (_, k) each."""
    squares = {t: part.T @ part for t, part in parts.items()}
    count = next(iter(parts.values())).shape[1]
    found: list[tuple[list[int], F64]] = []
    taken = np.zeros((count, 0))
    for size in range(1, min(_MOST_COMBINED, len(parts)) + 1):
        for combined in itertools.combinations(parts, size):
            if taken.shape[1] == count:
                return found
            inside = np.sum([squares[t] for t in combined], axis=0)
            values, vectors = np.linalg.eigh(inside)
            own = vectors[:, values > 1.0 - whole]
            fresh = own - taken @ (taken.T @ own)
            u, s, _ = svd(fresh)
            for k in range(int((s > 1e-3).sum())):
                # the representative inside this combination that owes least to those before
                mixed = own @ (own.T @ u[:, k])
                found.append((list(combined), (mixed / np.linalg.norm(mixed))[:, None]))
            taken = np.hstack([taken, u[:, s > 1e-3]])
    rest = _complement(taken)
    for k in range(rest.shape[1]):
        way = rest[:, k : k + 1]
        share = {t: float(np.linalg.norm(part @ way)) for t, part in parts.items()}
        found.append(([t for t in parts if share[t] > 0.05], way))
    return found


def _complement(taken: F64) -> F64:
    k = taken.shape[0]
    u, s, _ = svd(taken, full=True) if taken.shape[1] else (np.eye(k), (), None)
    return np.asarray(u[:, len(s) :])


def _groups(problem: Problem) -> dict[int, NDArray[np.int64]]:
    """Term → its indices in θ; −1: base points, −2: tools, −3: how warm bodies began."""
    layout = problem.layout
    groups = {t: np.arange(where.start, where.stop) for t, where in enumerate(layout.terms)}
    bases = [np.arange(w.start, w.stop) for w in layout.bases.values()]
    tools = [np.arange(w.start, w.stop) for w, _ in layout.tools.values()]
    if bases:
        groups[-1] = np.concatenate(bases)
    if tools:
        groups[-2] = np.concatenate(tools)
    if layout.starts:
        groups[-3] = np.concatenate([np.arange(s.where.start, s.where.stop) for s in layout.starts])
    return groups
