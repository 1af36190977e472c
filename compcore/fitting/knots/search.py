"""The search for the set of knots that the evidence is for: grown, thinned, moved."""

from __future__ import annotations

import numpy as np

from abbe.compcore.fitting.knots.evidence import KnotEvidence, KnotSet, losses_of, triangular

_LOOKS_BEYOND = 2.0
"""Knots are still added, to be tried, while they take so much off χ² (noise: 1)."""
_MOST = 8
"""Knots of an effect, on average, at which adding ends."""
_SWEEPS = 6


def best_set(evidence: KnotEvidence) -> KnotSet:
    """The set that the evidence is for."""
    chosen = _thinned(evidence, _grown(evidence, tuple(() for _ in evidence.curves)))
    for _ in range(_SWEEPS):
        before = evidence.score(chosen)
        chosen = _thinned(evidence, _settled(evidence, chosen))
        grown = _thinned(evidence, _grown(evidence, chosen))
        if evidence.score(grown) < evidence.score(chosen):
            chosen = grown
        if evidence.score(chosen) > before - 1e-6:
            break
    return chosen


def _grown(evidence: KnotEvidence, chosen: KnotSet) -> KnotSet:
    """Knots added one by one, beyond what pays, so that pairs are found too."""
    used = evidence.indices(chosen)
    left, columns = evidence.beyond(used, np.arange(evidence.columns.shape[1]))
    for _ in range(_MOST * len(evidence.curves) - len(used)):
        gains = evidence.gains_of(left, columns, evidence.size)
        gains[evidence.barred(chosen)] = -1.0
        at = int(gains.argmax())
        if gains[at] < _LOOKS_BEYOND:
            break
        chosen = evidence.with_one_more(chosen, at)
        q = columns[:, at] / np.linalg.norm(columns[:, at])
        left = left - q * float(q @ left)
        columns = columns - np.outer(q, q @ columns)
    return chosen


def _thinned(evidence: KnotEvidence, chosen: KnotSet) -> KnotSet:
    """The best set on the way down, the least useful knot taken out each time."""
    used = evidence.indices(chosen)
    whole = triangular(np.column_stack([evidence.columns[:, used], evidence.left]))
    kept = list(range(len(used)))
    best, least, chi2 = chosen, evidence.cost(len(kept)), 0.0
    while kept:
        losses = losses_of(whole, kept)
        i = int(losses.argmin())
        chi2 += float(losses[i])
        chosen = evidence.with_one_less(chosen, used[kept.pop(i)])
        if chi2 + evidence.cost(len(kept)) < least:
            best, least = chosen, chi2 + evidence.cost(len(kept))
    return best


def _settled(evidence: KnotEvidence, chosen: KnotSet) -> KnotSet:
    """Every knot at the best place that the others leave it."""
    for column in evidence.indices(chosen):
        e = int(evidence.curve_of[column])
        without = evidence.with_one_less(chosen, column)
        gains = evidence.gains(without, e)
        chosen = evidence.with_one_more(without, int(evidence.first[e]) + int(gains.argmax()))
    return chosen
