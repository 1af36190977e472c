"""The knots that an effect got, and how sure that is: the weight of all sets that are near."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.shapes import CUBIC
from abbe.compcore.fitting.knots.evidence import KnotEvidence, KnotSet
from abbe.compcore.fitting.knots.raster import GRID
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]

_SEEN = 1e-3
"""Weight, relative to the best, from which another choice counts."""

_Weighed = list[tuple[float, KnotSet]]
"""Sets, each with its difference in the criterion from the one that was chosen."""


@dataclass(frozen=True, slots=True)
class KnotChoice:
    """The knots that one effect got.

    Attributes
    ----------
    effect
        Its name without them: ``positioning axis=X shape=spline:auto``.
    axis
        The axis along which they stand.
    knots, spread
        Their places, and the standard deviation of each, mm (rotary: degrees).
    probability
        Number of knots → its share of the evidence, among the sets that were compared.
    curve_sd
        How far other choices would move the curve, standard deviation at its worst place, in the
        coefficients' unit; a straight line, which other effects hold, left out.
    unit
        That unit, inside the code (mm, rad, mm/kg, …).
    """

    effect: str
    axis: str
    knots: tuple[float, ...]
    spread: tuple[float, ...]
    probability: Mapping[int, float]
    curve_sd: float
    unit: str

    @property
    def where(self) -> str:
        """Unit of the places."""
        return "deg" if is_rotary(self.axis) else "mm"


def choice_of(evidence: KnotEvidence, e: int, chosen: KnotSet, effect: Effect) -> KnotChoice:
    """One curve's knots, with how sure they are.

    Parameters
    ----------
    e
        The curve's index.
    chosen
        The set that the evidence is for.
    effect
        The curve's effect with these knots.
    """
    curve = evidence.curves[e]
    spread, others = _moved(evidence, e, chosen)
    weighed = [(0.0, chosen), *_more_or_fewer(evidence, e, chosen), *others]
    weights = np.array([np.exp(-0.5 * max(min(d, 1e3), -1e2)) for d, _ in weighed])
    numbers = np.array([len(s[e]) for _, s in weighed])
    share = {int(k): float(weights[numbers == k].sum() / weights.sum()) for k in set(numbers)}
    share_of, apart = _apart(evidence, e, weighed, weights)
    bare = effect.model_copy(update={"positions": ()})
    return KnotChoice(
        bare.spec,
        curve.axis.name,
        tuple(float(curve.places[j]) for j in chosen[e]),
        tuple(spread),
        dict(sorted(share.items(), key=lambda item: -item[1])),
        float(np.sqrt((share_of @ apart**2).max())),
        curve.unit,
    )


def _more_or_fewer(evidence: KnotEvidence, e: int, chosen: KnotSet) -> _Weighed:
    """The sets in which one curve has one knot less, or one more."""
    count, first = sum(map(len, chosen)), int(evidence.first[e])
    more, fewer = (evidence.cost(count + by) - evidence.cost(count) for by in (1, -1))
    found: _Weighed = []
    if any(chosen):
        for column, loss in zip(evidence.indices(chosen), evidence.losses(chosen), strict=True):
            if evidence.curve_of[column] == e:
                found.append((loss + fewer, evidence.with_one_less(chosen, column)))
    for j, gain in enumerate(evidence.gains(chosen, e)):
        if gain >= 0.0:
            found.append((more - gain, evidence.with_one_more(chosen, first + j)))
    return found


def _moved(evidence: KnotEvidence, e: int, chosen: KnotSet) -> tuple[list[float], _Weighed]:
    """How surely each knot of a curve stands where it does, and the sets in which it is elsewhere.

    A knot is moved between its neighbours only; the others stay.
    """
    curve, own, first = evidence.curves[e], chosen[e], int(evidence.first[e])
    step = float(curve.places[1] - curve.places[0])
    spread: list[float] = []
    found: _Weighed = []
    for i, j in enumerate(own):
        without = evidence.with_one_less(chosen, first + j)
        gains = evidence.gains(without, e)
        low = own[i - 1] + 1 if i else 0
        high = own[i + 1] if i + 1 < len(own) else len(curve.places)
        between = np.arange(low, high)
        between = between[(gains[between] >= 0.0) | (between == j)]
        delta = gains[j] - gains[between]
        weight = np.exp(-0.5 * np.clip(delta, 0.0, 1e3))
        off = between - j
        spread.append(step * float(np.sqrt((weight * off**2).sum() / weight.sum() + 1.0 / 12)))
        found += [
            (float(d), evidence.with_one_more(without, first + int(b)))
            for b, d in zip(between, delta, strict=True)
            if b != j
        ]
    return spread, found


def _apart(
    evidence: KnotEvidence, e: int, weighed: Sequence[tuple[float, KnotSet]], weights: F64
) -> tuple[F64, F64]:
    """How far a curve lies from the chosen one in the sets that were compared.

    Returns
    -------
    share, apart
        Weight of each set that counts, (sets,), and its curve less the chosen one, a straight
        line left out, (sets, grid).
    """
    kept = weights > _SEEN * weights.max()
    curves = np.array(
        [_curve(evidence, e, s) for (_, s), k in zip(weighed, kept, strict=True) if k]
    )
    x = np.linspace(-1.0, 1.0, GRID)
    line = np.column_stack([np.ones(GRID), x])
    apart = curves - curves[0]
    apart = apart - (line @ np.linalg.lstsq(line, apart.T, rcond=None)[0]).T
    return weights[kept] / weights[kept].sum(), apart


def _curve(evidence: KnotEvidence, e: int, chosen: KnotSet) -> F64:
    """The curve of a set, (grid,), in its unit."""
    used = evidence.indices(chosen)
    values = np.zeros(evidence.columns.shape[1])
    if used:
        values[used] = np.linalg.lstsq(evidence.columns[:, used], evidence.left, rcond=None)[0]
    all_cubics, beside = evidence.back
    cubic = (all_cubics - beside @ values).reshape(-1, CUBIC + 1)[e]
    own = values[evidence.first[e] : evidence.first[e + 1]]
    x = np.linspace(-1.0, 1.0, GRID)
    count = len(own) + 1
    inner = np.arange(1, count) / count
    powers = np.clip((0.5 * (x + 1.0)[:, None] - inner) / (1.0 - inner), 0.0, None) ** 3
    scale = evidence.curves[e].scale
    return np.asarray(scale * (legendre.legvander(x, CUBIC) @ cubic + powers @ own))
