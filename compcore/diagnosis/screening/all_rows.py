"""All rows: causes that were found on some rows of a large campaign, measured on every one of them.

The rows are read once, in pieces, into the triangular factor of the model's columns, the causes'
columns and the residual: it has all their inner products, so that every question that is asked of
columns can be asked of the factor's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.candidates import Candidate
from abbe.compcore.diagnosis.screening.parameters import Estimate, neighbours, with_slopes
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.tried import Tried
from abbe.compcore.fitting.design.nuisance import Eliminator
from abbe.compcore.fitting.design.prepared_rows import OutsideEffect
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.reduction import triangle
from abbe.compcore.linalg import threads_for

F64 = NDArray[np.float64]

_ROUNDS = 3
_SETTLED = 0.1
"""Part of its standard deviation by which a non-linear parameter may still move."""


@dataclass(frozen=True, eq=False)
class Measured:
    """One cause as all rows show it, beside the others.

    Attributes
    ----------
    found
        The candidate with its evidence.
    estimates
        Its parameters.
    """

    found: WeighedCandidate
    estimates: tuple[Estimate, ...]


def measured(
    whole: FitResult, found: Sequence[WeighedCandidate], tried: Tried
) -> tuple[list[Measured], float]:
    """Causes as all rows of a campaign show them, and χ² per degree of freedom with all of them.

    Parameters
    ----------
    whole
        The fit of the model as it is, to all rows.
    found
        The causes, as some of the rows show them.
    tried
        The causes of which they were chosen.
    """
    with threads_for(whole.problem.n * whole.problem.layout.size):
        for _ in range(_ROUNDS):
            factor = _Factor(whole, found)
            moved = [factor.moved(i) for i in range(len(found))]
            if all(m is None for m in moved):
                break
            found = [f if m is None else m for f, m in zip(found, moved, strict=True)]
        return factor.measured(tried)


class _Factor:
    """The triangular factor of a model's columns, of causes' columns and of the residual."""

    def __init__(self, whole: FitResult, found: Sequence[WeighedCandidate]) -> None:
        self._whole = whole
        self._found = found
        self._machine = whole.problem.model.machine
        wanted: list[OutsideEffect] = []
        keys: list[tuple[int, str]] = []
        for i, f in enumerate(found):
            effect, chosen = f.candidate.effect, f.screened.nonlinear
            ends = neighbours(effect, chosen, self._machine).values()
            for nonlinear in [chosen, *(end for pair in ends for end in pair)]:
                wanted.append(OutsideEffect(effect, nonlinear, f.candidate.through))
                keys.append((i, _key(nonlinear)))
        rows = triangle(whole.problem, whole.theta, beside=wanted)
        m = whole.problem.layout.size
        d = whole.decomposition
        mixed = rows[:, :m] @ (d.scale[:, None] * d.determined / d.singular[: d.rank])
        q = np.linalg.qr(mixed)[0]
        residual = rows[:, -1] - q @ (q.T @ rows[:, -1])
        freedom = whole.dof + d.rank
        none = Eliminator((), np.zeros(0))
        self.basis = Basis(q, residual, none, np.zeros((len(rows), 0)), freedom)
        self._columns: dict[tuple[int, str], F64] = {}
        at = m
        for key, one in zip(keys, wanted, strict=True):
            width = len(one.effect.linear(self._machine))
            self._columns[key] = rows[:, at : at + width]
            at += width

    def columns(self, i: int, nonlinear: Mapping[str, float]) -> F64:
        """Rows of the factor that stand for a cause's columns."""
        return self._columns[i, _key(nonlinear)]

    def _beside(self, i: int) -> Basis:
        """What the model and all other causes leave."""
        basis = self.basis
        for j, other in enumerate(self._found):
            if j != i:
                basis = basis.extended(self.columns(j, other.screened.nonlinear))
        return basis

    def moved(self, i: int) -> WeighedCandidate | None:
        """A cause with its non-linear parameters a step nearer the best; None where they are."""
        found = self._found[i]
        effect, chosen = found.candidate.effect, found.screened.nonlinear
        smooth = list(neighbours(effect, chosen, self._machine))
        if not smooth:
            return None
        basis = self._beside(i)
        jacobian, _ = with_slopes(
            lambda nonlinear: self.columns(i, nonlinear), basis, effect, chosen, self._machine
        )
        projected = basis.project(jacobian)
        size = np.linalg.norm(projected, axis=0)
        size[size == 0.0] = 1.0
        step = np.linalg.lstsq(projected / size, basis.residual, rcond=1e-8)[0] / size
        widths = np.linalg.pinv((projected / size).T @ (projected / size), rcond=1e-10)
        sd = np.sqrt(np.maximum(np.diag(widths), 0.0)) / size
        bounds = {p.name: p.bounds for p in effect.nonlinear(self._machine)}
        nonlinear = dict(chosen)
        settled = True
        for name, by, width in zip(smooth, step[-len(smooth) :], sd[-len(smooth) :], strict=True):
            low, high = bounds[name]
            nonlinear[name] = float(min(max(chosen[name] + by, low), high))
            settled &= abs(nonlinear[name] - chosen[name]) < _SETTLED * width
        if settled:
            return None
        return replace(found, screened=replace(found.screened, nonlinear=nonlinear))

    def measured(self, tried: Tried) -> tuple[list[Measured], float]:
        """Every cause's evidence and parameters beside the others; χ²/dof with all of them."""
        chosen = [replace(f.candidate, choices=(f.screened.nonlinear,)) for f in self._found]
        index = {id(c): i for i, c in enumerate(chosen)}

        def columns(candidate: Candidate, nonlinear: Mapping[str, float]) -> F64:
            return self.columns(index[id(candidate)], nonlinear)

        pool = Pool(chosen, columns, self.basis, self._machine, tried=tried)
        after = self.basis
        for i, f in enumerate(self._found):
            after = after.extended(self.columns(i, f.screened.nonlinear))
        variance = after.variance
        out = []
        for i, f in enumerate(self._found):
            beside = self._beside(i)
            (own,) = pool.weighed(beside, [replace(f, screened=replace(f.screened, key=i))])
            again = replace(own.screened, key=f.key)
            estimates = pool.estimates(beside, own, variance)
            out.append(Measured(WeighedCandidate(f.candidate, again, own.evidence), estimates))
        return out, variance


def _key(nonlinear: Mapping[str, float]) -> str:
    return str(sorted(nonlinear.items()))
