"""The pool: every candidate with its columns at hand, tried, refined and weighed beside a model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.bounded_search import least
from abbe.compcore.diagnosis.screening.candidates import Candidate
from abbe.compcore.diagnosis.screening.evidence import (
    CONVINCING,
    Evidence,
    price_of,
    weigh,
    weigh_all,
)
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import LeftOut
from abbe.compcore.diagnosis.screening.parameters import Estimate, doubt_of, estimates
from abbe.compcore.diagnosis.screening.projection.bank import (
    Bank,
    ScreenedCandidate,
    Trial,
    drop_of,
    screen,
)
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.projection.frame import Frame, Placed
from abbe.compcore.diagnosis.screening.suddenness import Wander, gradual, stepping
from abbe.compcore.diagnosis.screening.tried import Tried
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

SIGNIFICANT = math.log(1e-4)
"""Greatest logarithm of the corrected p-value of an established candidate."""

MATERIAL = 0.01
"""Least fall of χ² per observation, in units of the noise, that is worth a cause."""

_INTERVALS = 30
"""Places looked at between two neighbouring moments of a grid."""

_SAME = 1e-9
"""Part of a fall of χ² by which two falls may differ and be the same."""


@dataclass(frozen=True, eq=False)
class WeighedCandidate:
    """A candidate as the data see it at one stage of the search.

    Attributes
    ----------
    candidate, screened, evidence
        What it is, how far χ² would fall, how strong that is.
    doubt
        What of the evidence implausible values took away (`parameters.doubt_of`), or, of a step,
        that a wander says nearly as much (`suddenness`).
    """

    candidate: Candidate
    screened: ScreenedCandidate
    evidence: Evidence
    doubt: float = 0.0

    @property
    def key(self) -> int:
        """Its index among all candidates."""
        return self.screened.key

    def established(self, n: int) -> bool:
        """Whether the data establish it, for n observations."""
        e = self.evidence
        return e.value > CONVINCING and e.f_drop > MATERIAL * n and e.log_p < SIGNIFICANT


class _Array:
    """An array as a key: the same only if it is the very same array."""

    def __init__(self, values: F64) -> None:
        self._values = values

    def __hash__(self) -> int:
        return id(self._values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Array) and other._values is self._values


_Asked = tuple[_Array, _Array, int, tuple[tuple[str, float], ...]]
"""Residual and extra columns of a basis, key and non-linear parameters of a cause."""


def _at(basis: Basis) -> tuple[_Array, _Array]:
    return _Array(basis.residual), _Array(basis.extra)


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
    tried
        The causes of which these were chosen; default these are all.
    placed
        The same columns where they are seen (`Frames.columns`); default `columns`.
    time
        Of each row, s; without it a step is not weighed against gradual changes.
    """

    def __init__(
        self,
        candidates: Sequence[Candidate],
        columns: Columns,
        fitted: Basis,
        machine: Machine,
        *,
        tried: Tried | None = None,
        placed: Callable[[Candidate, Mapping[str, float]], F64 | Placed] | None = None,
        time: F64 | None = None,
    ) -> None:
        self.candidates = list(candidates)
        self.tried = Tried.among(self.candidates) if tried is None else tried
        self._tests = self.tried.beside(self.candidates)
        self.machine = machine
        self._columns = columns
        self._time = time
        self._placed = columns if placed is None else placed
        self._bank = Bank(fitted, self._trials)
        self._known: dict[_Asked, Basis] = {}
        self._screened: dict[tuple[_Array, _Array], list[ScreenedCandidate]] = {}
        self._refined: dict[tuple[_Asked, float, float, float], WeighedCandidate] = {}
        self._left_out: dict[tuple[_Array, _Array, int], LeftOut] = {}
        self._steps: dict[int, F64] = {}

    def columns(self, key: int, nonlinear: Mapping[str, float]) -> F64:
        """Weighted columns of one candidate at given non-linear parameters, shape (n, k)."""
        return self._columns(self.candidates[key], nonlinear)

    def _trials(self) -> Iterator[Trial]:
        for key, candidate in enumerate(self.candidates):
            for nonlinear in candidate.choices:
                yield key, nonlinear, partial(self._placed, candidate, nonlinear)

    def joined(self, basis: Basis, found: Iterable[WeighedCandidate]) -> Basis:
        """A basis after causes joined the model, one after the other; worked out once."""
        for f in found:
            key = (*_at(basis), f.key, tuple(f.screened.nonlinear.items()))
            if key not in self._known:
                self._known[key] = basis.extended(self.found_columns(f))
            known = self._known[key]
            basis = replace(basis, residual=known.residual, extra=known.extra)
        return basis

    def left_out(self, basis: Basis, rows: Sequence[NDArray[np.int64]]) -> LeftOut:
        """What a basis leaves of folds that are left out (`Blocks` keeps them); worked out once."""
        key = (*_at(basis), id(rows))
        if key not in self._left_out:
            self._left_out[key] = LeftOut.of(basis, rows)
        return self._left_out[key]

    def imitated(self, basis: Basis, signature: F64) -> dict[int, float]:
        """How much of a signature's square each candidate can imitate: key → ‖P_{C⊥} v‖².

        `signature` is weighted and projected, shape (n,).
        """
        beside = basis.with_residual(signature)
        return {s.key: s.drop for s in self._bank.screen(beside) if s.rank}

    def ranked(self, basis: Basis, without: frozenset[int] = frozenset()) -> list[WeighedCandidate]:
        """All candidates that the campaign can see, strongest evidence first."""
        key = _at(basis)
        if key not in self._screened:
            self._screened[key] = self._bank.screen(basis)
        screened = [s for s in self._screened[key] if s.rank and s.key not in without]
        chosen = [self.candidates[s.key] for s in screened]
        costs = [c.cost for c in chosen]
        counts = [c.nonlinear_count for c in chosen]
        tests = [self._tests[s.key] for s in screened]
        weighed = weigh_all(basis, screened, tests, costs, counts)
        found = list(map(WeighedCandidate, chosen, screened, weighed))
        found.sort(key=lambda f: -f.evidence.value)
        return found

    def weighed(self, basis: Basis, found: Sequence[WeighedCandidate]) -> list[WeighedCandidate]:
        """The same candidates, at the non-linear parameters they have, against another basis."""
        out = []
        by_key = {f.key: f for f in found}
        trials = ((f.key, f.screened.nonlinear, partial(self.found_columns, f)) for f in found)
        for s in screen(basis, trials):
            f = by_key[s.key]
            again = ScreenedCandidate(s.key, s.nonlinear, s.drop, s.rank, f.screened.tried)
            if again.rank or len(found) == 1:
                weighed = WeighedCandidate(f.candidate, again, self._weigh(basis, again))
                out.append(self._doubted(basis, weighed))
        return out

    def _weigh(self, basis: Basis, screened: ScreenedCandidate, cost: float = 0.0) -> Evidence:
        candidate = self.candidates[screened.key]
        return weigh(
            basis,
            screened,
            self._tests[screened.key],
            candidate.cost + cost,
            candidate.nonlinear_count,
        )

    def estimates(
        self, basis: Basis, found: WeighedCandidate, variance: float
    ) -> tuple[Estimate, ...]:
        """A found candidate's parameters as they would be fitted."""
        return estimates(
            partial(self.columns, found.key),
            basis,
            found.candidate.effect,
            found.screened.nonlinear,
            self.machine,
            variance,
        )

    def _doubted(self, basis: Basis, found: WeighedCandidate) -> WeighedCandidate:
        """The same with less evidence where a parameter is implausible, or a step not sudden."""
        if not found.established(basis.n):
            return found
        left = max(0.0, basis.chi2 - found.screened.drop)
        variance = left / max(1, basis.dof - found.screened.rank)
        fitted = self.estimates(basis, found, variance)
        doubt = doubt_of(fitted)
        if found.candidate.effect.reads_model and not all(
            e.plausible and e.measured for e in fitted
        ):
            # a thermometer does not read wrong by any amount: its reading describes, no more
            doubt += found.evidence.value
        values = {e.name: e.value for e in fitted}
        if any(e.impossible for e in fitted) or found.candidate.effect.misnamed(values):
            doubt += found.evidence.value
        doubt += self._lingering(basis, found)
        if doubt <= 0.0:
            return found
        weighed = self._weigh(basis, found.screened, doubt)
        return WeighedCandidate(found.candidate, found.screened, weighed, doubt)

    def _lingering(self, basis: Basis, found: WeighedCandidate) -> float:
        """What of a step's evidence a wander has as well; 0 of what is no step."""
        candidate = found.candidate
        if not stepping(candidate.effect, self.machine) or len(candidate.choices) < 2:
            return 0.0
        if found.key not in self._steps:
            steps = [self.columns(found.key, moment) for moment in candidate.choices]
            self._steps[found.key] = np.hstack(steps)
        wander, step = Wander.of(basis, self._steps[found.key]), self.found_columns(found)
        likelier = wander.likelier_with(step)
        if likelier and self._time is not None and candidate.effect.of_the_clock:
            (name, moment) = next(iter(found.screened.nonlinear.items()))
            everywhere = self.columns(found.key, {name: float(self._time.min())})
            slowly = everywhere * gradual(self._time, moment)
            if wander.likelier_slowly(step, slowly) > price_of(basis, 1, 0.0):
                likelier = 0.0
        count = found.screened.rank + candidate.nonlinear_count
        return max(0.0, found.evidence.value - likelier + price_of(basis, count, candidate.cost))

    def refined(self, basis: Basis, found: WeighedCandidate) -> WeighedCandidate:
        """The same candidate with its non-linear parameters moved to the best place nearby.

        Worked out once: beside the same causes the same candidates are asked about again and again.
        """
        screened = found.screened
        cause = (*_at(basis), found.key, tuple(screened.nonlinear.items()))
        asked = (cause, screened.drop, found.doubt, basis.share)
        if asked not in self._refined:
            self._refined[asked] = self._nearby(basis, found)
        return self._refined[asked]

    def _nearby(self, basis: Basis, found: WeighedCandidate) -> WeighedCandidate:
        candidate = self.candidates[found.key]
        if not candidate.nonlinear_count:
            return self._doubted(basis, found)
        names = list(found.screened.nonlinear)
        chosen = np.array([found.screened.nonlinear[name] for name in names])
        tried = [np.unique([c[name] for c in candidate.choices]) for name in names]
        bounds = [_around(value, grid) for value, grid in zip(chosen, tried, strict=True)]
        whole = Frame.whole(basis)

        def loss(values: F64) -> float:
            nonlinear = dict(zip(names, map(float, np.atleast_1d(values)), strict=True))
            return -drop_of(basis, whole, self._placed(candidate, nonlinear))

        if stepping(candidate.effect, self.machine):
            # a step: the fall of χ² is flat between rows, so every interval is looked at
            grid = product(*(_on_and_off_the_flat(loss, chosen, i, g) for i, g in enumerate(tried)))
            drop, values = max((-loss(np.array(v)), v) for v in grid)
        elif len(names) == 1:
            within = 1e-3 * (bounds[0][1] - bounds[0][0])
            best, missed = least(lambda v: loss(np.array([v])), bounds[0], within)
            values, drop = (best,), -missed
        else:
            # half a second of import, for those that need it
            from scipy import optimize

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
        s = ScreenedCandidate(found.key, nonlinear, drop, found.screened.rank, found.screened.tried)
        return self._doubted(basis, WeighedCandidate(candidate, s, self._weigh(basis, s)))

    def found_columns(self, found: WeighedCandidate) -> F64:
        """Columns of a found candidate, those of its non-linear parameters' slopes not included."""
        return self.columns(found.key, found.screened.nonlinear)


def _on_and_off_the_flat(loss: Callable[[F64], float], chosen: F64, which: int, grid: F64) -> F64:
    """Values of a step's parameter to look at, from before to after all that say the same, (k,).

    Where for a while no row sees the step, neighbours on the grid say exactly the same, and the
    best may lie beyond any of them.
    """

    def level(at: int) -> float:
        return loss(np.where(np.arange(len(chosen)) == which, grid[at], chosen))

    first = last = int(np.searchsorted(grid, chosen[which]))
    here = level(first)
    same = _SAME * abs(here)
    while first > 0 and abs(level(first - 1) - here) <= same:
        first -= 1
    while last < len(grid) - 1 and abs(level(last + 1) - here) <= same:
        last += 1
    (low, _), (_, high) = _around(grid[first], grid), _around(grid[last], grid)
    return np.linspace(low, high, _INTERVALS * (last - first + 2) + 1)


def _around(chosen: float, grid: F64) -> tuple[float, float]:
    """The neighbouring values on a grid, between which the best must lie."""
    at = int(np.searchsorted(grid, chosen))
    low = grid[max(0, at - 1)]
    high = grid[min(len(grid) - 1, at + 1)]
    return (float(low), float(high)) if high > low else (float(low) * 0.5, float(low) * 1.5 + 1e-9)
