"""The search: which candidate, or which few together, explain what the model leaves over.

One after the other: the best candidate joins the model, all are tested again. Two causes may hide
each other, so that neither leads alone: the leading candidates are also tested in pairs, and a
pair that explains clearly more than the first two found one by one takes their place.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.candidates import PLAIN, RIGID
from abbe.compcore.diagnosis.screening.evidence import CONVINCING, INDISTINCT, log_chance, price_of
from abbe.compcore.diagnosis.screening.levers import WITH_A_LEVER, shift_of
from abbe.compcore.diagnosis.screening.pool import SIGNIFICANT, Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis, orthonormal
from abbe.compcore.diagnosis.screening.projection.falls import drops_together
from abbe.compcore.diagnosis.screening.suddenness import stepping
from abbe.compcore.effects import OverhangSag

F64 = NDArray[np.float64]

_PAIRS_OF = 40
_MOST = 4
_ROUNDS = 3
_CLEARLY = 4.0
_SEEN = 1e-4
"""Eigenvalues of what two causes span together, below which both say the same."""
_ROUNDING = 1e-12
"""Part of χ² below which what is left is rounding."""
_NO_LEVER = 2.0
"""Evidence that a turn must have before the shift that it would be without a lever, as of a
reversal angle before a backlash."""

_LEVEL = "X"
"""The axis that is horizontal on every machine (ISO 841): along it nothing sags."""

LEADERS = 6
"""Candidates whose non-linear parameters are refined before one of them is taken."""


def search(pool: Pool, basis: Basis) -> tuple[list[WeighedCandidate], list[WeighedCandidate]]:
    """Find the causes that together explain what the model leaves.

    The search begins twice, from nothing and from the plain geometry that the model lacks taken
    together (`PLAIN`); what explains more in the end, at the same prices, is kept. So what is
    found first does not decide what is found.

    Returns
    -------
    established
        In the order found, the strongest first; empty where nothing is missing.
    ranked
        All candidates against the model as it is, strongest evidence first.
    """
    ranked = pool.ranked(basis)
    if basis.chi2 <= 0.0:
        return [], ranked  # the model explains every digit: nothing is left to be explained
    found = _from_nothing(pool, basis, ranked)
    plain = _plain(pool, basis, ranked)
    if plain and {f.key for f in plain} != {f.key for f in found}:
        other = _settled(pool, basis, _forward(pool, basis, plain))
        if _preferred(pool, basis, other, found):
            found = other
    return found, ranked


def _preferred(
    pool: Pool, basis: Basis, plain: Sequence[WeighedCandidate], found: Sequence[WeighedCandidate]
) -> bool:
    """Whether what began with plain geometry says more than what began with nothing.

    Of plain geometry in place of error motions of rigid bodies each coefficient is paid for: that
    every axis has them makes shapes no likelier. What both have in common does not matter.
    """
    if _value(pool, basis, plain) > _value(pool, basis, found):
        return True
    common = {f.key for f in plain} & {f.key for f in found}
    ours = [f.candidate.effect.kind for f in plain if f.key not in common]
    theirs = [f.candidate.effect.kind for f in found if f.key not in common]
    bodies = all(kind in (*RIGID, *PLAIN) for kind in ours) and any(
        kind in RIGID for kind in theirs
    )
    return bodies and _value(pool, basis, plain, bare=True) > _value(pool, basis, found, bare=True)


def _value(
    pool: Pool, basis: Basis, found: Sequence[WeighedCandidate], *, bare: bool = False
) -> float:
    """Evidence of several causes together; 0 of none; `bare`: with every coefficient paid for."""
    if not found:
        return 0.0
    after = pool.joined(basis, found)
    saved = sum(_saved(basis, f) for f in found) if bare else 0.0
    return joint_value(basis, after, found) - saved


def _saved(basis: Basis, found: WeighedCandidate) -> float:
    """What a cause does not pay for because every axis has it."""
    count = found.screened.rank + found.candidate.nonlinear_count
    dearer = count * math.log(basis.independent) + max(0.0, found.candidate.cost + found.doubt)
    return max(0.0, dearer - _price(basis, found))


def _worse(basis: Basis, now: WeighedCandidate, best: WeighedCandidate) -> bool:
    """Whether another candidate says clearly more than one that was found.

    A shape takes the place of plain geometry only if it is worth each of its coefficients.
    """
    lead = best.evidence.value - now.evidence.value
    if now.candidate.effect.kind in PLAIN and best.candidate.effect.kind in RIGID:
        lead -= _saved(basis, best) - _saved(basis, now)
    return lead > _CLEARLY


def _plain(pool: Pool, basis: Basis, ranked: Sequence[WeighedCandidate]) -> list[WeighedCandidate]:
    """The plain geometry that the model lacks and the data want, all of it taken together.

    The weakest goes, one after another, until each is established beside the others. Of several
    that say the same, as three scales of circles whose radius is not known, it is the one that says
    least alone.
    """
    kept = [f for f in ranked if f.candidate.effect.kind in PLAIN]
    alone = {f.key: f.evidence.value for f in kept}
    while kept:
        weighed: list[WeighedCandidate] = []
        for f in kept:
            beside = pool.joined(basis, (g for g in kept if g.key != f.key))
            weighed += pool.weighed(beside, [f])
        least = min(f.evidence.value for f in weighed) + INDISTINCT
        if all(f.established(basis.n) for f in weighed):
            return sorted(weighed, key=lambda f: -f.evidence.value)
        weak = [f for f in weighed if not f.established(basis.n) and f.evidence.value <= least]
        weakest = min(weak or weighed, key=lambda f: alone[f.key])
        kept = [f for f in weighed if f.key != weakest.key]
    return []


def _forward(pool: Pool, basis: Basis, start: Sequence[WeighedCandidate]) -> list[WeighedCandidate]:
    """Some causes, and up to `_MOST` more, one after the other, each the best beside the others."""
    out = list(start)
    current = pool.joined(basis, out)
    for _ in range(_MOST):
        first = pool.ranked(current, taken(pool, out))
        leaders = [pool.refined(current, f) for f in _leading(first)]
        leader = _established(_simplest(pool, current, leaders), leaders, basis.n)
        if leader is None:
            break
        out.append(leader)
        current = pool.joined(current, [leader])
    return out


def _established(
    first: WeighedCandidate | None, leaders: Sequence[WeighedCandidate], n: int
) -> WeighedCandidate | None:
    """The first of the leaders if it is established, or one that is and is no less likely.

    A commoner cause that explains less may stand before one that the data establish, by less than
    distinguishes them. Which of them it is remains open; that something is there does not.
    """
    if first is None or first.established(n):
        return first
    least = first.evidence.value - INDISTINCT
    alike = [f for f in leaders if f.evidence.value > least and f.established(n)]
    return max(alike, key=lambda f: f.evidence.value, default=None)


def _leading(ranked: Sequence[WeighedCandidate]) -> list[WeighedCandidate]:
    """The strongest candidates, and the shifts that turns among them are without a lever."""
    first = list(ranked[:LEADERS])
    turns = [g for g in first if g.candidate.effect.kind in WITH_A_LEVER]
    return first + [f for f in ranked[LEADERS:] if any(_shift_of(f, g) for g in turns)]


def _cause(found: WeighedCandidate) -> tuple[str, tuple[tuple[str, str], ...]]:
    return found.candidate.cause


def taken(pool: Pool, found: Sequence[WeighedCandidate]) -> frozenset[int]:
    """Candidates that are causes already found, in whatever detail: a cause comes in once."""
    causes = {_cause(f) for f in found}
    return frozenset(k for k, c in enumerate(pool.candidates) if c.cause in causes)


def _from_nothing(
    pool: Pool, basis: Basis, ranked: list[WeighedCandidate]
) -> list[WeighedCandidate]:
    """Causes found one by one, or after a pair that says clearly more than the first two."""
    established = _forward(pool, basis, ())
    pair = _best_pair(pool, basis, ranked)
    if pair is not None:
        found, value = pair
        # a pair with an event in it that is none is no pair
        both = _beside_each_other(pool, basis, found)
        value -= sum(f.doubt for f in both if stepping(f.candidate.effect, pool.machine))
        pair_keys = {f.key for f in found}
        # one cause as two are: a coefficient of a large error costs more where it is weighed alone
        reached = _value(pool, basis, established[:2])
        if value > reached + CONVINCING and pair_keys != {f.key for f in established[:2]}:
            together = _settled(pool, basis, _after_pair(pool, basis, found))
            # of which one falls away is no pair, and at the prices of single causes it may say less
            least = _value(pool, basis, established)
            if len(together) > 1 and _value(pool, basis, together) > least:
                return together
    return _settled(pool, basis, established)


def _settled(
    pool: Pool, basis: Basis, established: Sequence[WeighedCandidate]
) -> list[WeighedCandidate]:
    """The same causes after each was weighed again beside all others.

    What was found first was found while the others were still unknown: a candidate that now
    says clearly more takes its place, and one that has become superfluous goes.
    """
    out = list(established)
    for _ in range(_ROUNDS if len(out) > 1 else 0):
        changed = False
        for f in list(out):
            rest = [g for g in out if g.key != f.key]
            beside = pool.joined(basis, rest)
            ranked = pool.ranked(beside, taken(pool, rest))
            (now,) = pool.weighed(beside, [f])
            leaders = [pool.refined(beside, r) for r in [now, *_leading(ranked)]]
            best = _simplest(pool, beside, leaders) or now
            if not best.established(basis.n):
                out, changed = rest, True
            elif best.key != f.key and (
                not now.established(basis.n) or _worse(beside, now, best) or _rarer(now, best)
            ):
                out, changed = [best if g.key == f.key else g for g in out], True
            elif shifts := [g for g in leaders if _shift_of(g, now)]:
                shift = max(shifts, key=lambda g: g.evidence.value)
                out, changed = [shift if g.key == f.key else g for g in out], True
            elif best.key == f.key:
                out = [best if g.key == f.key else g for g in out]
        if not changed:
            break
    return sorted(out, key=lambda f: -f.evidence.value)


def _simplest(
    pool: Pool, basis: Basis, leaders: Sequence[WeighedCandidate]
) -> WeighedCandidate | None:
    """The strongest; where a plainer one says the same, that one, unless it is clearly worse.

    Plainer is one cause in less detail, and a cause that is a special case of the strongest: a
    scale factor of a positioning error, a squareness of a straightness.
    """
    if not leaders:
        return None
    best = max(leaders, key=lambda f: f.evidence.value)
    if shifts := [f for f in leaders if _shift_of(f, best)]:
        best = max(shifts, key=lambda f: f.evidence.value)
    if best.candidate.everywhere:
        # of the instrument, and nothing was measured without it: a machine's cause that says the
        # same leads
        alike = [
            f
            for f in leaders
            if f.candidate.effect.scope != "instrument"
            and f.evidence.value >= best.evidence.value - INDISTINCT
        ]
        best = max(alike, key=lambda f: f.evidence.value, default=best)
    if common := [f for f in leaders if _rarer(best, f) and f.established(basis.n)]:
        best = max(common, key=lambda f: f.evidence.value)
    special = [f for f in leaders if _special_case(pool, basis, f, best)]
    if special:
        best = max(special, key=lambda f: f.evidence.value)
    alike = [
        f
        for f in leaders
        if f.candidate.cause == best.candidate.cause
        and f.evidence.value >= best.evidence.value - INDISTINCT
    ]
    return min(
        alike,
        key=lambda f: (f.screened.rank + f.candidate.nonlinear_count, -f.evidence.value),
    )


def _rarer(found: WeighedCandidate, other: WeighedCandidate) -> bool:
    """Whether one is an axis's turn by another's position, the other an axis's own error motion.

    Where the data do not tell them apart it is the error motion, which every axis has; nor do they
    where it explains all that the other does: its coefficients are expected, and of a large error
    each costs more than its price, as it takes a degree of freedom.
    """
    cross, own = found.candidate.effect.kind, other.candidate.effect.kind
    alike = (
        other.evidence.value >= found.evidence.value - INDISTINCT
        or other.screened.drop >= found.screened.drop
    )
    return cross == "cross_angular" and own in RIGID and alike


def _shift_of(found: WeighedCandidate, best: WeighedCandidate) -> bool:
    """Whether one is the shift that another is where nothing differs, and nothing says it does."""
    return (
        shift_of(found.candidate.effect, best.candidate.effect)
        and found.evidence.value > best.evidence.value - _NO_LEVER
    )


def _special_case(
    pool: Pool, basis: Basis, plain: WeighedCandidate, wide: WeighedCandidate
) -> bool:
    """Whether one candidate is a special case of an error motion that says nothing beyond it.

    What the plain one explains the error motion must be able to imitate within the noise; what
    that explains further is tested as its further coefficients alone deserve: that every axis has
    such a motion (`RIGID_BODY`) is no reason to prefer it to one of its own special cases. What is
    free in several ways is none: gravity from anywhere draws any first wave of a rotary axis, as an
    eccentric graduation does, and that is commoner. Nor is one that no sound machine shows: a wave
    as long as the travel is no screw's.
    """
    further = wide.screened.rank - plain.screened.rank - plain.candidate.nonlinear_count
    one, other = plain.candidate.effect, wide.candidate.effect
    if other.kind not in RIGID or one.kind in RIGID or further <= 0:
        return False
    if one.kind == "cross_angular":
        return False  # that an axis turns by where another stands is rarer than its own error
    if isinstance(one, OverhangSag) and (
        getattr(other, "direction", None) != one.direction or one.direction == _LEVEL
    ):
        return False  # nobody saw it sag, but a turn or a bow that a sag would make too
    if plain.screened.rank > 1 and not plain.candidate.nonlinear_count:
        return False
    if not set(one.signals_needed()) <= set(other.signals_needed()):
        return False
    if not plain.established(basis.n) or plain.doubt > 0.0:
        return False
    dof = max(1, basis.dof - wide.screened.rank)
    # rows may lie on a line to the last digit: what is left is then no noise but rounding
    left = max(basis.chi2 - wide.screened.drop, _ROUNDING * basis.chi2)
    variance = left / dof
    beyond = (wide.screened.drop - plain.screened.drop) / variance
    if log_chance(beyond / further, further, dof) < SIGNIFICANT:
        return False
    span = _span(pool, basis, wide)
    own = _span(pool, basis, plain)
    signature = own @ (own.T @ basis.residual)
    missed = signature - span @ (span.T @ signature)
    return bool(missed @ missed < variance)


def _span(pool: Pool, basis: Basis, found: WeighedCandidate) -> F64:
    """Orthonormal basis of what a candidate can explain beside a model, shape (n, rank)."""
    columns = pool.found_columns(found)
    return orthonormal(basis.project(columns), np.linalg.norm(columns, axis=0))


def _spans(pool: Pool, basis: Basis, found: Sequence[WeighedCandidate]) -> list[F64]:
    """As `_span`, of several candidates at once."""
    columns = [pool.found_columns(f) for f in found]
    projected = basis.project(np.hstack(columns))
    ends = np.cumsum([c.shape[1] for c in columns]).tolist()
    return [
        orthonormal(projected[:, end - c.shape[1] : end], np.linalg.norm(c, axis=0))
        for end, c in zip(ends, columns, strict=True)
    ]


def _after_pair(
    pool: Pool, basis: Basis, found: Sequence[WeighedCandidate]
) -> list[WeighedCandidate]:
    """A pair in the model, and whatever comes after it; each weighed beside the others."""
    out = _beside_each_other(pool, basis, found)
    current = pool.joined(basis, found)
    if not all(f.established(basis.n) for f in out):
        return [f for f in out if f.established(basis.n)]
    out.sort(key=lambda f: -f.evidence.value)
    while len(out) < _MOST:
        more = pool.ranked(current, taken(pool, out))
        if not more or not more[0].established(basis.n):
            break
        best = pool.refined(current, more[0])
        out.append(best)
        current = pool.joined(current, [best])
    return out


def _beside_each_other(
    pool: Pool, basis: Basis, found: Sequence[WeighedCandidate]
) -> list[WeighedCandidate]:
    """Each of several causes, weighed beside the others."""
    out: list[WeighedCandidate] = []
    for i, f in enumerate(found):
        other = pool.joined(basis, (g for j, g in enumerate(found) if j != i))
        out += pool.weighed(other, [f])
    return out


def joint_value(before: Basis, after: Basis, found: Sequence[WeighedCandidate]) -> float:
    """Evidence for several causes together, in the units of `Evidence.value`."""
    price = sum(_price(before, f) for f in found)
    fall = math.log(before.chi2 / max(after.chi2, 1e-300))
    return before.share * before.dof * fall - price


def _price(basis: Basis, found: WeighedCandidate) -> float:
    count = found.screened.rank + found.candidate.nonlinear_count
    return price_of(basis, count, found.candidate.cost + found.doubt)


def _best_pair(
    pool: Pool, basis: Basis, ranked: Sequence[WeighedCandidate]
) -> tuple[list[WeighedCandidate], float] | None:
    """The pair of leading candidates with the strongest joint evidence, and that evidence."""
    leading = sorted(ranked, key=lambda f: -f.screened.drop / f.screened.rank)[:_PAIRS_OF]
    by_value = [f for f in ranked[:_PAIRS_OF] if f not in leading]
    leading = [*leading, *by_value]
    if len(leading) < 2:
        return None
    spans = _spans(pool, basis, leading)
    stacked = np.hstack(spans)
    gram = stacked.T @ stacked
    moment = stacked.T @ basis.residual
    ends = np.cumsum([s.shape[1] for s in spans]).tolist()
    places = [np.arange(e - s.shape[1], e) for e, s in zip(ends, spans, strict=True)]
    prices = [_price(basis, f) for f in leading]
    best: tuple[float, int, int] | None = None
    for pairs in _alike(leading, places):
        by_width = [sorted(pair, key=lambda k: -len(places[k])) for pair in pairs]
        wide, narrow = (np.array([places[pair[k]] for pair in by_width]) for k in (0, 1))
        cross = gram[wide[:, :, None], narrow[:, None, :]]
        drop, rank = drops_together(cross, moment[wide], moment[narrow], _SEEN)
        left = np.maximum(basis.chi2 - drop, 1e-12 * basis.chi2)
        value = basis.share * basis.dof * np.log(basis.chi2 / left)
        # what both can say is paid once, if it was paid at all: each cause costs a coefficient
        one = math.log(basis.independent)
        price = np.array([prices[i] + prices[j] for i, j in pairs])
        width = wide.shape[1] + narrow.shape[1]
        value -= np.maximum(price - (width - rank) * one, 2.0 * one)
        # where one imitates the other they are no two causes
        value[rank <= wide.shape[1]] = -math.inf
        at = int(value.argmax())
        if value[at] > -math.inf and (best is None or value[at] > best[0]):
            best = (float(value[at]), *pairs[at])
    if best is None:
        return None
    worth, i, j = best
    return [leading[i], leading[j]], worth


def _alike(
    leading: Sequence[WeighedCandidate], places: Sequence[NDArray[np.int64]]
) -> Iterable[list[tuple[int, int]]]:
    """Pairs of different causes, those of as many columns each together."""
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    causes = [_cause(f) for f in leading]
    for i, j in combinations(range(len(leading)), 2):
        if causes[i] != causes[j]:
            one, other = sorted((len(places[i]), len(places[j])))
            found.setdefault((one, other), []).append((i, j))
    return found.values()
