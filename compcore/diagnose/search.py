"""The search: which candidate, or which few together, explain what the model leaves over.

One after the other: the best candidate joins the model, all are tested again. Two causes may hide
each other, so that neither leads alone: the leading candidates are also tested in pairs, and a
pair that explains clearly more than the first two found one by one takes their place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from compcore.diagnose.candidates import Candidate
from compcore.diagnose.evidence import CONVINCING, IMPLAUSIBLE, INDISTINCT, Evidence, weigh
from compcore.diagnose.parameters import Estimate, estimates
from compcore.diagnose.screening import Bank, Basis, Screened, Trial, orthonormal, screen
from compcore.machine import Machine
from compcore.revise import identity

F64 = NDArray[np.float64]

SIGNIFICANT = math.log(1e-4)
"""Greatest logarithm of the corrected p-value of an established candidate."""

MATERIAL = 0.01
"""Least fall of χ² per observation, in units of the noise, that is worth a cause."""

_PAIRS_OF = 40
_MOST = 4
_ROUNDS = 3
_CLEARLY = 4.0
_INTERVALS = 61
_LEADERS = 6


@dataclass(frozen=True, eq=False)
class Found:
    """A candidate as the data see it at one stage of the search.

    Attributes
    ----------
    candidate, screened, evidence
        What it is, how far χ² would fall, how strong that is.
    """

    candidate: Candidate
    screened: Screened
    evidence: Evidence

    @property
    def key(self) -> int:
        """Its index among all candidates."""
        return self.screened.key

    def established(self, n: int) -> bool:
        """Whether the data establish it, for n observations."""
        e = self.evidence
        return e.value > CONVINCING and e.f_drop > MATERIAL * n and e.log_p < SIGNIFICANT


Columns = Callable[[Candidate, Mapping[str, float]], F64]


class Pool:
    """All candidates with their weighted columns at hand.

    Parameters
    ----------
    candidates
        What may be tried.
    columns
        Weighted columns (n, k) of a candidate at a choice of its non-linear parameters.
    fitted
        The basis of the fitted model.
    machine
        The machine.
    """

    def __init__(
        self, candidates: Sequence[Candidate], columns: Columns, fitted: Basis, machine: Machine
    ) -> None:
        self.candidates = list(candidates)
        self.machine = machine
        self._columns = columns
        self._bank = Bank(fitted, self._trials)

    def columns(self, key: int, nonlinear: Mapping[str, float]) -> F64:
        """Weighted columns of one candidate at given non-linear parameters, shape (n, k)."""
        return self._columns(self.candidates[key], nonlinear)

    def _trials(self) -> Iterator[Trial]:
        for key, candidate in enumerate(self.candidates):
            for nonlinear in candidate.choices:
                yield key, nonlinear, partial(self.columns, key, nonlinear)

    def imitated(self, basis: Basis, signature: F64) -> dict[int, float]:
        """How much of a signature's square each candidate can imitate: key → ‖P_{C⊥} v‖².

        `signature` is weighted and projected, shape (n,).
        """
        beside = basis.with_residual(signature)
        return {s.key: s.drop for s in self._bank.screen(beside) if s.rank}

    def ranked(self, basis: Basis, without: frozenset[int] = frozenset()) -> list[Found]:
        """All candidates that the campaign can see, strongest evidence first."""
        found = [
            Found(self.candidates[s.key], s, self._weigh(basis, s))
            for s in self._bank.screen(basis, without)
            if s.rank
        ]
        found.sort(key=lambda f: -f.evidence.value)
        return found

    def weighed(self, basis: Basis, found: Sequence[Found]) -> list[Found]:
        """The same candidates, at the non-linear parameters they have, against another basis."""
        out = []
        by_key = {f.key: f for f in found}
        trials = ((f.key, f.screened.nonlinear, partial(self.found_columns, f)) for f in found)
        for s in screen(basis, trials):
            f = by_key[s.key]
            again = Screened(s.key, s.nonlinear, s.drop, s.rank, f.screened.tried)
            if again.rank or len(found) == 1:
                weighed = Found(f.candidate, again, self._weigh(basis, again))
                out.append(self._doubted(basis, weighed))
        return out

    def _weigh(self, basis: Basis, screened: Screened, cost: float = 0.0) -> Evidence:
        candidate = self.candidates[screened.key]
        return weigh(
            basis,
            screened,
            len(self.candidates),
            candidate.cost + cost,
            candidate.nonlinear_count,
        )

    def estimates(self, basis: Basis, found: Found, variance: float) -> tuple[Estimate, ...]:
        """A found candidate's parameters as they would be fitted."""
        return estimates(
            partial(self.columns, found.key),
            basis,
            found.candidate.effect,
            found.screened.nonlinear,
            self.machine,
            variance,
        )

    def _doubted(self, basis: Basis, found: Found) -> Found:
        """The same with less evidence where a parameter would be implausible."""
        if not found.established(basis.n):
            return found
        variance = (basis.chi2 - found.screened.drop) / max(1, basis.dof - found.screened.rank)
        if all(e.plausible for e in self.estimates(basis, found, variance)):
            return found
        return Found(
            found.candidate, found.screened, self._weigh(basis, found.screened, IMPLAUSIBLE)
        )

    def refined(self, basis: Basis, found: Found) -> Found:
        """The same candidate with its non-linear parameters moved to the best place nearby."""
        candidate = found.candidate
        if not candidate.nonlinear_count:
            return self._doubted(basis, found)
        names = list(found.screened.nonlinear)
        chosen = np.array([found.screened.nonlinear[name] for name in names])
        neighbours = np.array([[c[name] for name in names] for c in candidate.choices])
        bounds = [_around(chosen[i], neighbours[:, i]) for i in range(len(names))]

        def loss(values: F64) -> float:
            nonlinear = dict(zip(names, map(float, np.atleast_1d(values)), strict=True))
            (s,) = screen(
                basis, [(found.key, nonlinear, lambda: self.columns(found.key, nonlinear))]
            )
            return -s.drop

        if not all(p.smooth for p in candidate.effect.nonlinear(self.machine)):
            # a step: the fall of χ² is flat between rows, so every interval is looked at
            grid = product(*(np.linspace(low, high, _INTERVALS) for low, high in bounds))
            drop, values = max((-loss(np.array(v)), v) for v in grid)
        elif len(names) == 1:
            best = optimize.minimize_scalar(
                lambda v: loss(np.array([v])),
                bounds=bounds[0],
                method="bounded",
                options={"xatol": 1e-3 * (bounds[0][1] - bounds[0][0])},
            )
            values, drop = (float(best.x),), -float(best.fun)
        else:
            found_best = optimize.minimize(
                loss,
                chosen,
                method="Nelder-Mead",
                bounds=bounds,
                options={"maxfev": 120, "xatol": 1e-3, "fatol": 1e-2},
            )
            values, drop = tuple(map(float, found_best.x)), -float(found_best.fun)
        if drop <= found.screened.drop:
            return self._doubted(basis, found)
        nonlinear = dict(zip(names, map(float, values), strict=True))
        s = Screened(found.key, nonlinear, drop, found.screened.rank, found.screened.tried)
        return self._doubted(basis, Found(candidate, s, self._weigh(basis, s)))

    def found_columns(self, found: Found) -> F64:
        """Columns of a found candidate, those of its non-linear parameters' slopes not included."""
        return self.columns(found.key, found.screened.nonlinear)


def search(pool: Pool, basis: Basis) -> tuple[list[Found], list[Found]]:
    """Find the causes that together explain what the model leaves.

    Returns
    -------
    established
        In the order found, the strongest first; empty where nothing is missing.
    ranked
        All candidates against the model as it is, strongest evidence first.
    """
    ranked = pool.ranked(basis)
    established: list[Found] = []
    current, first = basis, ranked
    while len(established) < _MOST:
        leader = _simplest([pool.refined(current, f) for f in first[:_LEADERS]])
        if leader is None or not leader.established(basis.n):
            break
        established.append(leader)
        current = current.extended(pool.found_columns(leader))
        first = pool.ranked(current, frozenset(f.key for f in established))
    pair = _best_pair(pool, basis, ranked)
    if pair is not None:
        found, value = pair
        pair_keys = {f.key for f in found}
        if len(established) >= 2:
            two = basis
            for f in established[:2]:
                two = two.extended(pool.found_columns(f))
            reached = joint_value(basis, two, established[:2])
        else:
            reached = established[0].evidence.value if established else 0.0
        if value > reached + CONVINCING and pair_keys != {f.key for f in established[:2]}:
            established = _after_pair(pool, basis, found)
    return _settled(pool, basis, established), ranked


def _settled(pool: Pool, basis: Basis, established: Sequence[Found]) -> list[Found]:
    """The same causes after each was weighed again beside all others.

    What was found first was found while the others were still unknown: a candidate that now
    says clearly more takes its place, and one that has become superfluous goes.
    """
    out = list(established)
    for _ in range(_ROUNDS if len(out) > 1 else 0):
        changed = False
        for f in list(out):
            rest = [g for g in out if g.key != f.key]
            beside = basis
            for g in rest:
                beside = beside.extended(pool.found_columns(g))
            ranked = pool.ranked(beside, frozenset(g.key for g in rest))
            (now,) = pool.weighed(beside, [f])
            best = _simplest([pool.refined(beside, r) for r in [now, *ranked[:_LEADERS]]]) or now
            if not best.established(basis.n):
                out, changed = rest, True
            elif best.key != f.key and best.evidence.value > now.evidence.value + _CLEARLY:
                out, changed = [best if g.key == f.key else g for g in out], True
            elif best.key == f.key:
                out = [best if g.key == f.key else g for g in out]
        if not changed:
            break
    return sorted(out, key=lambda f: -f.evidence.value)


def _simplest(leaders: Sequence[Found]) -> Found | None:
    """The strongest; of one cause in more or less detail the plainer, unless clearly worse."""
    if not leaders:
        return None
    best = max(leaders, key=lambda f: f.evidence.value)
    alike = [
        f
        for f in leaders
        if identity(f.candidate.effect) == identity(best.candidate.effect)
        and f.evidence.value > best.evidence.value - INDISTINCT
    ]
    return min(
        alike,
        key=lambda f: (f.screened.rank + f.candidate.nonlinear_count, -f.evidence.value),
    )


def _after_pair(pool: Pool, basis: Basis, found: Sequence[Found]) -> list[Found]:
    """A pair in the model, and whatever comes after it; each weighed beside the others."""
    out: list[Found] = []
    current = basis
    for f in found:
        current = current.extended(pool.found_columns(f))
    for i, f in enumerate(found):
        other = basis
        for j, g in enumerate(found):
            if j != i:
                other = other.extended(pool.found_columns(g))
        out += pool.weighed(other, [f])
    if not all(f.established(basis.n) for f in out):
        return [f for f in out if f.established(basis.n)]
    out.sort(key=lambda f: -f.evidence.value)
    while len(out) < _MOST:
        more = pool.ranked(current, frozenset(f.key for f in out))
        if not more or not more[0].established(basis.n):
            break
        best = pool.refined(current, more[0])
        out.append(best)
        current = current.extended(pool.found_columns(best))
    return out


def joint_value(before: Basis, after: Basis, found: Sequence[Found]) -> float:
    """Evidence for several causes together, in the units of `Evidence.value`."""
    price = sum(
        (f.screened.rank + f.candidate.nonlinear_count) * math.log(before.n) + f.candidate.cost
        for f in found
    )
    return before.dof * math.log(before.chi2 / max(after.chi2, 1e-300)) - price


def _best_pair(
    pool: Pool, basis: Basis, ranked: Sequence[Found]
) -> tuple[list[Found], float] | None:
    """The pair of leading candidates with the strongest joint evidence, and that evidence."""
    leading = sorted(ranked, key=lambda f: -f.screened.drop / f.screened.rank)[:_PAIRS_OF]
    by_value = [f for f in ranked[:_PAIRS_OF] if f not in leading]
    leading = [*leading, *by_value]
    spans = []
    for f in leading:
        c = pool.found_columns(f)
        spans.append(orthonormal(basis.project(c), np.linalg.norm(c, axis=0)))
    if len(spans) < 2:
        return None
    stacked = np.hstack(spans)
    gram = stacked.T @ stacked
    moment = stacked.T @ basis.residual
    ends = np.cumsum([s.shape[1] for s in spans])
    slices = [slice(e - s.shape[1], e) for e, s in zip(ends, spans, strict=True)]
    best: tuple[float, int, int] | None = None
    for i in range(len(leading)):
        for j in range(i + 1, len(leading)):
            a, b = slices[i], slices[j]
            index = np.r_[a, b]
            values, vectors = np.linalg.eigh(gram[np.ix_(index, index)])
            seen = values > 1e-4
            part = vectors[:, seen].T @ moment[index]
            drop = float((part**2 / values[seen]).sum())
            left = max(basis.chi2 - drop, 1e-12 * basis.chi2)
            fi, fj = leading[i], leading[j]
            count = int(seen.sum()) + fi.candidate.nonlinear_count + fj.candidate.nonlinear_count
            value = basis.dof * math.log(basis.chi2 / left) - count * math.log(basis.n)
            value -= fi.candidate.cost + fj.candidate.cost
            if best is None or value > best[0]:
                best = (value, i, j)
    if best is None:
        return None
    value, i, j = best
    return [leading[i], leading[j]], value


def _around(chosen: float, tried: F64) -> tuple[float, float]:
    """The neighbouring values on a grid, between which the best must lie."""
    grid = np.unique(tried)
    at = int(np.searchsorted(grid, chosen))
    low = grid[max(0, at - 1)]
    high = grid[min(len(grid) - 1, at + 1)]
    return (float(low), float(high)) if high > low else (float(low) * 0.5, float(low) * 1.5 + 1e-9)
