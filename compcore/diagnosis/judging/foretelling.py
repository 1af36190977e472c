"""The causes that a search finds and that foretell left-out blocks, with the rows that count.

How many rows are independent is a property of the noise, not of what is still unexplained: a body
that nobody has named yet makes its readings alike through a whole day. So everything that foretells
left-out blocks is taken out first, all of it together, however much it is. The correlation of what
is then left *of blocks that were left out* says which part of the rows counts; of the fitted rows
it would say too much, for what follows the noise whitens it. With that the causes are searched
again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from abbe.compcore.diagnosis.screening.candidates import ALONG_AN_AXIS, RIGID
from abbe.compcore.diagnosis.screening.evidence import CONVINCING, INDISTINCT
from abbe.compcore.diagnosis.screening.left_out.blocks import Blocks
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import gain
from abbe.compcore.diagnosis.screening.left_out.independence import independent_share
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.search import LEADERS, joint_value, search, taken
from abbe.compcore.diagnosis.screening.suddenness import stepping

ALIKE = 0.9
"""Part of the rows that count as independent from which on all are taken to."""

_MOST = 40
"""Causes that are taken out together; as many as a course has steps."""

_NO_BETTER = 1e-6
"""Part of the left-out variance by which two causes that are one and the same may differ."""

WORTH = 0.01
"""Least part of the left-out χ² that a further one removes; as of what is worth a cause."""


def foretelling(
    pool: Pool, basis: Basis, blocks: Blocks
) -> tuple[Basis, list[WeighedCandidate], list[WeighedCandidate]]:
    """The causes that predict rows left out, and all candidates as the search ranked them.

    Parameters
    ----------
    pool, basis
        The candidates, and what the fitted model leaves.
    blocks
        The campaign's rows, in blocks that are left out, each in its turn.

    Returns
    -------
    basis
        The same with as many rows independent as the noise allows; with all where no cause stands.
    established, ranked
        As of `search`.
    """
    chosen, ranked = search(pool, basis)
    share = independent_share(pool.joined(basis, chosen).residual, blocks.conditions)
    if chosen and share < ALIKE:
        # what the causes leave is alike from row to row: fewer rows speak than were counted
        together = _together(pool, basis, chosen, blocks)
        left = pool.left_out(pool.joined(basis, together), blocks.usual).residual
        basis = replace(basis, share=max(share, independent_share(left, blocks.conditions)))
        first = _standing(pool, basis, chosen)
        chosen, ranked = search(pool, basis)
        bodies = sum(bool(f.candidate.effect.signals_needed()) for f in first)
        convinces = _worth(pool, basis, first) > _worth(pool, basis, chosen) + CONVINCING
        if bodies > 1 and convinces:
            chosen = first
    chosen = _guided(pool, basis, _reading(pool, basis, chosen, blocks), blocks)
    chosen = predicting(pool, basis, chosen, blocks)
    return basis if chosen else replace(basis, share=1.0), chosen, ranked


def _standing(
    pool: Pool, basis: Basis, found: Sequence[WeighedCandidate]
) -> list[WeighedCandidate]:
    """Those of several causes that fewer rows still establish, each beside the others.

    The weakest goes first. Two bodies that warm at their own pace are found together or not at all:
    a search that begins anew with few rows finds neither beside the other's whole signature.
    """
    kept = list(found)
    while kept:
        after = [
            pool.weighed(pool.joined(basis, (g for g in kept if g.key != f.key)), [f])[0]
            for f in kept
        ]
        weak = [f for f in after if not f.established(basis.n)]
        if not weak:
            return sorted(after, key=lambda f: -f.evidence.value)
        weakest = min(weak, key=lambda f: f.evidence.value)
        kept = [f for f in kept if f.key != weakest.key]
    return []


def _worth(pool: Pool, basis: Basis, found: Sequence[WeighedCandidate]) -> float:
    """Evidence of several causes together; 0 of none."""
    return joint_value(basis, pool.joined(basis, found), found) if found else 0.0


def _reading(
    pool: Pool, basis: Basis, chosen: Sequence[WeighedCandidate], blocks: Blocks
) -> list[WeighedCandidate]:
    """The causes with a signal in place of the clock, where it says as much and foretells better.

    What follows the clock alone says nothing of another day. Where the evidence of the two is no
    distinction, the gain on left-out blocks decides.
    """
    out = list(chosen)
    for f in chosen:
        if not f.candidate.effect.of_the_clock:
            continue
        others = [g for g in out if g.key != f.key]
        beside = pool.joined(basis, others)
        (now,) = pool.weighed(beside, [f])
        alike = [
            pool.refined(beside, g)
            for g in pool.ranked(beside, taken(pool, others))[:LEADERS]
            if g.candidate.effect.scope != "instrument" and g.candidate.effect.signals_needed()
        ]
        gains = {
            g.key: (foretold(pool, beside, g, blocks, pool.joined(beside, [g])), g.evidence.value)
            for g in (now, *alike)
            if g.established(basis.n) and g.evidence.value > now.evidence.value - INDISTINCT
        }
        # of those that foretell the same, as an offset and a tilt that no lever tells apart, the
        # likelier one
        most = max((foretells for foretells, _ in gains.values()), default=0.0)
        same = [key for key, (foretells, _) in gains.items() if foretells > most - _NO_BETTER]
        best = max(same, key=lambda key: gains[key][1], default=f.key)
        out = [next((g for g in alike if g.key == best), f) if g is f else g for g in out]
    return out


def _guided(
    pool: Pool, basis: Basis, chosen: Sequence[WeighedCandidate], blocks: Blocks
) -> list[WeighedCandidate]:
    """The causes with an axis's error motion in place of a dent or a wave that foretells less.

    A guideway is bent in waves of its bolts, and turns what it carries: one of them looks like a
    dent, and through a lever like a screw's turn. In enough detail its error motion explains all of
    it, and foretells the others.
    """
    out = list(chosen)
    for f in chosen:
        if f.candidate.effect.kind not in ALONG_AN_AXIS:
            continue
        axis = getattr(f.candidate.effect, "axis", "")
        others = [g for g in out if g.key != f.key]
        beside = pool.joined(basis, others)
        own = foretold(pool, beside, f, blocks, pool.joined(beside, [f]))
        motions = [
            g
            for g in pool.ranked(beside, taken(pool, others))
            if g.candidate.effect.kind in RIGID
            and getattr(g.candidate.effect, "axis", "") == axis
            and g.established(basis.n)
            and g.screened.drop >= f.screened.drop
        ]
        gains = {
            g.key: foretold(pool, beside, g, blocks, pool.joined(beside, [g]))
            for g in motions[:LEADERS]
        }
        best = max(gains, key=lambda key: gains[key], default=f.key)
        if best in gains and gains[best] > own + WORTH:
            (instead,) = (g for g in motions if g.key == best)
            out = [instead if g is f else g for g in out]
    return out


def _together(
    pool: Pool, basis: Basis, found: Sequence[WeighedCandidate], blocks: Blocks
) -> list[WeighedCandidate]:
    """All that foretells left-out blocks, taken together, the strongest first."""
    kept = predicting(pool, basis, found, blocks)
    refused: set[int] = set()
    while len(kept) < _MOST:
        current = pool.joined(basis, kept)
        for f in pool.ranked(current, taken(pool, kept) | refused)[:LEADERS]:
            # time constants as they were tried: a finer one makes the noise no more alike
            if not f.established(basis.n):
                continue
            if foretold(pool, current, f, blocks, pool.joined(current, [f])) > WORTH:
                kept.append(f)
                break
            refused.add(f.key)
        else:
            return kept
    return kept


def foretold(
    pool: Pool, beside: Basis, found: WeighedCandidate, blocks: Blocks, after: Basis
) -> float:
    """By how much better a cause, beside others, predicts blocks that were left out.

    `after`: the basis with all of them. An event of which one block alone shows what was before it,
    or what came after, foretells nothing there.
    """
    effect = found.candidate.effect
    rows = blocks.for_effects([effect])
    without, with_it = pool.left_out(beside, rows), pool.left_out(after, rows)
    at_a_moment = effect.of_the_clock and stepping(effect, pool.machine)
    if at_a_moment and any(m > w for w, m in zip(without.alone, with_it.alone, strict=True)):
        return 0.0
    if cut := blocks.cut_for([effect], without, with_it):
        without, with_it = pool.left_out(beside, cut), pool.left_out(after, cut)
    return gain(without, with_it, bound=effect.scope == "instrument")


def predicting(
    pool: Pool, basis: Basis, chosen: Sequence[WeighedCandidate], blocks: Blocks
) -> list[WeighedCandidate]:
    """Those causes that predict blocks which were left out, each beside the others.

    The one that predicts worst goes first; the others are looked at again without it.
    """
    kept = list(chosen)
    while kept:
        gains = []
        after = pool.joined(basis, kept)
        for f in kept:
            others = pool.joined(basis, (g for g in kept if g.key != f.key))
            gains.append(foretold(pool, others, f, blocks, after))
        worst = int(np.argmin(gains))
        if gains[worst] > 0.0:
            break
        del kept[worst]
    return kept
