"""Causes from the catalogue against descriptions of structure: who explains what.

A wrong cause is worse than none: a cause is established only where nothing empirical says clearly
more, unless it predicts better what was left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from abbe.compcore.diagnosis.judging.foretelling import ALIKE, predicting
from abbe.compcore.diagnosis.screening.candidates import RIGID
from abbe.compcore.diagnosis.screening.evidence import CONVINCING
from abbe.compcore.diagnosis.screening.left_out.blocks import Blocks, passes
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import LeftOut, gain
from abbe.compcore.diagnosis.screening.left_out.independence import independent_share
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.search import joint_value, search
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import Patterns, ResidualPattern
from abbe.compcore.effects.catalogue.linear.reversal import ReversalEffect

_SAME = 2.0
"""Difference in χ² that is none."""

_COINCIDENCE = 8.0
"""What each further cause costs beside one description that says the same: a coincidence."""

_ALL_BUT = 0.999
"""Part of what the best description explains above which a cause is not its rival, but nearly all
of it: what is left is a thirtieth in size."""

_MOST_OF = 0.5
"""Part of what the best description explains from which on reversals are what it describes."""

_PASSES = 4
"""Passes along an axis, two each way, from which on what flips from one to the next is no drift."""

BEYOND_DOUBT = 40.0
"""Least evidence of a cause that is found beside structure which no cause explains."""


def compete(
    pool: Pool,
    basis: Basis,
    chosen: Sequence[WeighedCandidate],
    patterns: Patterns,
    blocks: Blocks,
) -> tuple[list[WeighedCandidate], list[ResidualPattern]]:
    """Causes from the catalogue against descriptions of structure: who explains what.

    Returns the causes that stand, and the structure that no cause explains.
    """
    strong = patterns.established(basis)
    if not strong:
        return list(chosen), []
    kept, left = _judged(pool, basis, list(chosen), strong, patterns, blocks)
    reversals = _reversals(pool, basis, chosen, strong[0])
    if {f.key for f in reversals} <= {f.key for f in kept}:
        return kept, left
    return reversals, patterns.established(pool.joined(basis, reversals))


def _judged(
    pool: Pool,
    basis: Basis,
    chosen: list[WeighedCandidate],
    strong: list[ResidualPattern],
    patterns: Patterns,
    blocks: Blocks,
) -> tuple[list[WeighedCandidate], list[ResidualPattern]]:
    """The causes that stand against the descriptions, and the structure that none explains."""
    after = pool.joined(basis, chosen)
    by_causes = (
        joint_value(basis, after, chosen) - _COINCIDENCE * (len(chosen) - 1) if chosen else 0.0
    )
    left = patterns.established(after) if chosen else strong
    # a description costs `EMPIRICAL` more: where it says more all the same, no cause is named,
    # unless the causes predict better what was left out
    foretell = bool(chosen) and _foretell(pool, basis, after, chosen, strong[0], blocks)
    better = strong[0].evidence.value > by_causes and not foretell
    # a function of one position is an error motion of its axis, however plainly it can be described
    rigid = bool(chosen) and all(f.candidate.effect.kind in RIGID for f in chosen)
    # one cause that explains as much as the description says it too, with what else belongs to it
    covers = len(chosen) == 1 and basis.chi2 - after.chi2 > strong[0].drop - _SAME
    if not left and (rigid or covers or not better):
        return chosen, []
    # what one cause leaves of a description is described after it, where that is little of it
    if left and len(chosen) == 1 and basis.chi2 - after.chi2 > _ALL_BUT * strong[0].drop:
        return chosen, left
    # something is left whatever the catalogue offers
    more_said = by_causes > strong[0].evidence.value + CONVINCING
    if left and chosen and not better and (more_said or foretell):
        # the causes say more than any one description; but a cause further down the list may
        # only be imitating what is left, and is kept only if it stands beside the description
        kept = _beside(pool, basis, chosen, left, patterns)
        if len(kept) == len(chosen):
            return kept, left
        # what the others explained is unexplained again
        return kept, patterns.established(pool.joined(basis, kept)) if kept else strong
    extended = basis
    described: list[ResidualPattern] = []
    for s in strong[:1]:
        extended = extended.extended(patterns.with_lower_orders(s))
        described.append(s)
    more, _ = search(pool, extended)
    # an instrument's cause is fitted to the very rows that show it: beside structure that is only
    # described it takes up what the description leaves there
    more = [
        f
        for f in more
        if f.evidence.value > BEYOND_DOUBT and f.candidate.effect.scope != "instrument"
    ]
    if more:
        both = pool.joined(extended, more)
        more = [] if patterns.established(both) else more
    return more, described + [s for s in strong[1:] if s not in described]


def reversals_described(
    pool: Pool, basis: Basis, patterns: Patterns, blocks: Blocks
) -> list[WeighedCandidate]:
    """The reversals of an axis that a description, established of all rows, would say without name.

    Where no cause stands with the few rows that are independent, what is left is described as it
    is, with all rows. What then flips with an axis's direction is its reversal: a formula of the
    direction would be the same correction, and say less. Of a play along the axis, and of one way
    there and back, nothing is said: what drifts meanwhile is that too.
    """
    strong = patterns.established(basis)
    if not strong or not any(name.endswith("_dir") for name in strong[0].depends_on):
        return []
    found = [
        f
        for f in search(pool, basis)[0]
        if isinstance(f.candidate.effect, ReversalEffect)
        and f.screened.rank == 1
        and len(passes(blocks.conditions, f.candidate.effect.axis)) >= _PASSES
    ]
    return predicting(pool, basis, _reversals(pool, basis, found, strong[0]), blocks)


def _reversals(
    pool: Pool, basis: Basis, chosen: Sequence[WeighedCandidate], described: ResidualPattern
) -> list[WeighedCandidate]:
    """The reversals of an axis that say most of a description which flips with its direction.

    Nothing else flips with it. What they leave is how the play grows along another axis, or with
    the feed: that is described beside them, and is no rival.
    """
    own = [f for f in chosen if _flips(described, f)]
    explained = basis.chi2 - pool.joined(basis, own).chi2
    return own if own and explained > _MOST_OF * described.drop else []


def rivals(
    described: Sequence[ResidualPattern], chosen: Sequence[WeighedCandidate]
) -> list[ResidualPattern]:
    """Those descriptions that are not how one of the causes, a reversal, varies."""
    return [s for s in described if not any(_flips(s, f) for f in chosen)]


def _flips(described: ResidualPattern, found: WeighedCandidate) -> bool:
    """Whether a description flips with the direction of the axis of which a cause is a reversal."""
    effect = found.candidate.effect
    return isinstance(effect, ReversalEffect) and f"{effect.axis}_dir" in described.depends_on


def _foretell(
    pool: Pool,
    basis: Basis,
    after: Basis,
    chosen: Sequence[WeighedCandidate],
    described: ResidualPattern,
    blocks: Blocks,
) -> bool:
    """Whether causes predict blocks that were left out better than a description does."""
    effects = [f.candidate.effect for f in chosen]
    rows = blocks.for_effects(effects)
    before, caused = pool.left_out(basis, rows), pool.left_out(after, rows)
    if cut := blocks.cut_for(effects, before, caused):
        rows = cut
        before, caused = pool.left_out(basis, rows), pool.left_out(after, rows)
    bound = all(e.scope == "instrument" for e in effects)
    by_causes = gain(before, caused, bound=bound)
    return by_causes > gain(before, LeftOut.of(basis.extended(described.columns), rows))


def _beside(
    pool: Pool,
    basis: Basis,
    chosen: Sequence[WeighedCandidate],
    left: Sequence[ResidualPattern],
    patterns: Patterns,
) -> list[WeighedCandidate]:
    """Those causes that stay established once the structure that is left is described."""
    described = basis
    for s in left:
        described = described.extended(patterns.with_lower_orders(s))
    kept: list[WeighedCandidate] = []
    for f in chosen:
        (again,) = pool.weighed(described, [f])
        if not again.established(basis.n):
            continue
        kept.append(f)
        described = pool.joined(described, [f])
    return kept


def standing_beside(
    pool: Pool,
    basis: Basis,
    chosen: Sequence[WeighedCandidate],
    described: Sequence[ResidualPattern],
    blocks: Blocks,
) -> list[WeighedCandidate]:
    """Those causes found beside a description that stand as any other has to.

    With as many rows as are independent, and by predicting blocks that were left out.
    """
    beside = basis
    for s in described:
        beside = beside.extended(s.columns)
    share = independent_share(pool.joined(beside, chosen).residual, blocks.conditions)
    if share < ALIKE:
        beside = replace(beside, share=min(share, basis.share))
        again = pool.weighed(beside, chosen)
        chosen = [f for f in again if f.established(basis.n) and f.evidence.value > BEYOND_DOUBT]
    return predicting(pool, beside, chosen, blocks)
