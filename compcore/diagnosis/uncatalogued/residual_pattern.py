"""Structure: is anything left in the residuals, and what does it depend on?"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.evidence import CONVINCING, Evidence, weigh
from abbe.compcore.diagnosis.screening.frames import Frames
from abbe.compcore.diagnosis.screening.pool import MATERIAL, SIGNIFICANT
from abbe.compcore.diagnosis.screening.projection.bank import ScreenedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.uncatalogued.pattern_bank import PatternBank, PatternFamily
from abbe.compcore.diagnosis.uncatalogued.patterns.motions import (
    error_motions,
    lever_axes,
    turned_by_joints,
)
from abbe.compcore.diagnosis.uncatalogued.patterns.oscillations import (
    oscillation,
    oscillations,
    swings,
)
from abbe.compcore.diagnosis.uncatalogued.patterns.pattern import CandidatePattern, grouped
from abbe.compcore.diagnosis.uncatalogued.patterns.products import products, surfaces, with_product
from abbe.compcore.diagnosis.uncatalogued.patterns.variables import PatternVariable, variables
from abbe.compcore.diagnosis.uncatalogued.short_formula import shortened
from abbe.compcore.fitting.design.design_matrix import Problem

F64 = NDArray[np.float64]

EMPIRICAL = 12.0
"""Cost of a description that names no cause, in units of evidence."""

TILT = 6.0
"""Further cost of one on an axis's tilt: seen through levers, it depends on more than it says."""

_MANY_ROWS = 20_000

_KEPT = 12
_KEPT_PRODUCTS = 40
"""Of a family's patterns those that are looked at closely; of a product of three half may be
elsewhere, in a product of two."""

_NEARBY = 21
"""Periods that are tried between a period's neighbours."""

_HARMONICS = 3
"""Of what repeats and is not a sine."""


@dataclass(frozen=True, eq=False)
class ResidualPattern:
    """A pattern that the residuals show.

    Attributes
    ----------
    pattern
        What it depends on and how.
    made
        Makes its weighted columns.
    evidence
        How strong it is.
    drop
        Fall of χ² if it were added.
    depends_on
        Recorded quantities, those of the levers of a tilt included.
    """

    pattern: CandidatePattern
    made: Callable[[], F64] = field(repr=False)
    evidence: Evidence
    drop: float
    depends_on: tuple[str, ...]

    @property
    def columns(self) -> F64:
        """Weighted columns, shape (n, k)."""
        return self.made()

    def established(self, n: int) -> bool:
        """Whether the data establish that the structure is there, for n observations."""
        e = self.evidence
        return e.value > CONVINCING and e.f_drop > MATERIAL * n and e.log_p < SIGNIFICANT


class Patterns:
    """All patterns for a campaign, to be tested against what a model leaves, again and again.

    Parameters
    ----------
    problem, theta
        The model and campaign, and where base points and tools stand.
    frames
        What each error motion's rows see.
    """

    def __init__(self, problem: Problem, theta: F64, frames: Frames) -> None:
        campaign = problem.campaign
        machine = self._machine = problem.model.machine
        self._quantities = variables(machine, campaign.conditions)
        on = error_motions(machine)
        self._joints, self._turned = turned_by_joints(machine, [q.name for q in self._quantities])
        tangent = problem.tangent(theta)
        self._seen = {c: tangent.sensitivity(c) * problem.weight for c in on}
        order = 3 if campaign.n <= _MANY_ROWS else 2
        shortest = _shortest(self._quantities)
        quantities, point = self._quantities, on[0]
        self._frames = frames
        self._families = [
            PatternFamily(grouped(list(products(quantities, point, order))), on, frames),
            PatternFamily(grouped(list(surfaces(quantities, point))), on[:3], frames),
            PatternFamily(list(oscillations(quantities, point, shortest)), on[:3], frames),
            PatternFamily(list(swings(quantities, point, shortest)), on[:3], frames),
        ]
        self._kept = (_KEPT_PRODUCTS, _KEPT, _KEPT, _KEPT)

    def columns(self, pattern: CandidatePattern) -> F64:
        """Weighted columns of a pattern, shape (n, k)."""
        return np.asarray(self._seen[pattern.error_motion][:, None] * pattern.basis)

    def strongest(self, basis: Basis, most: int = 5) -> list[ResidualPattern]:
        """The strongest patterns in the residuals, strongest first, no two nearly the same."""
        found: list[ResidualPattern] = []
        for family, kept in zip(self._families, self._kept, strict=True):
            found += self._weighed(basis, family.leading(basis, kept), len(family))
        found.sort(key=lambda s: -s.evidence.value)
        return self._distinct(basis, found, most)

    def established(self, basis: Basis) -> list[ResidualPattern]:
        """The strongest patterns that the data establish; with a formula where a short one does."""
        found = [s for s in self.strongest(basis) if s.established(basis.n)]
        return [self._shortened(basis, s) for s in found]

    def _shortened(self, basis: Basis, structure: ResidualPattern) -> ResidualPattern:
        pattern = structure.pattern
        if pattern.error_motion in self._turned and self._joints.intersection(structure.depends_on):
            return replace(structure, pattern=replace(pattern, terms=()))
        if pattern.terms and len(pattern.factors) < 2:
            return structure
        seen = self._seen[pattern.error_motion]
        return replace(
            structure,
            pattern=shortened(basis, pattern, self._quantities, seen, structure.drop),
        )

    def with_lower_orders(self, structure: ResidualPattern) -> F64:
        """Columns of a pattern and, of a product of three quantities, of its products of two.

        The quantities are counted from the middle of what was recorded, nature counts from
        elsewhere: (X − x₀)·(Y − y₀)·(T − T₀) has a part in X·Y alone for any other T₀.
        """
        pattern = structure.pattern
        value = {q.name: q.value for q in self._quantities}
        seen = self._seen[pattern.error_motion]
        pairs = dict.fromkeys(combinations(pattern.factors, 2)) if len(pattern.factors) > 2 else ()
        lower = [(seen * value[a] * value[b])[:, None] for a, b in pairs]
        return np.hstack([structure.columns, *lower])

    def _weighed(
        self, basis: Basis, patterns: Sequence[CandidatePattern], tests: int
    ) -> list[ResidualPattern]:
        """Each pattern in the form that says most."""
        refined = iter(self._refined_periods(basis, [p for p in patterns if p.wave is not None]))
        forms: list[tuple[int, CandidatePattern, int]] = []
        for i, pattern in enumerate(patterns):
            if pattern.wave is None:
                forms += [(i, p, 0) for p in (pattern, *self._counted_from_elsewhere(pattern))]
                continue
            best = next(refined)
            w = best.wave or pattern.wave
            repeated = oscillation(w.v, w.period, best.error_motion, w.along, harmonics=_HARMONICS)
            forms += [(i, best, 1), (i, repeated, 1)]
        bank = PatternBank([form for _, form, _ in forms], self._frames)
        seen = {s.key: s for s in bank.screen(basis)}
        strongest: dict[int, ResidualPattern] = {}
        for key, (i, form, chosen) in enumerate(forms):
            one = self._structure(basis, form, seen.get(key, ScreenedCandidate(key)), tests, chosen)
            if i not in strongest or one.evidence.value > strongest[i].evidence.value:
                strongest[i] = one
        return list(strongest.values())

    def _counted_from_elsewhere(self, pattern: CandidatePattern) -> Iterator[CandidatePattern]:
        """A product of three quantities with one of its products of two beside it.

        (X − x₀)·(Y − y₀)·(T − T₀) has a part in X·Y alone for any T₀ but the middle of what was
        recorded; either part alone may look like something else.
        """
        if len(pattern.factors) < 3:
            return
        by_name = {q.name: q for q in self._quantities}
        factors = [by_name[name] for name in pattern.factors]
        for pair in dict.fromkeys(combinations(factors, 2)):
            yield with_product(pattern, pair)

    def _structure(
        self,
        basis: Basis,
        pattern: CandidatePattern,
        s: ScreenedCandidate,
        tests: int,
        refined: int,
    ) -> ResidualPattern:
        cost = EMPIRICAL + (TILT if pattern.error_motion.rotation else 0.0)
        evidence = weigh(basis, s, tests, cost, refined)
        levers = lever_axes(self._machine, pattern.error_motion)
        depends = tuple(dict.fromkeys((*pattern.depends_on, *levers)))
        return ResidualPattern(pattern, partial(self.columns, pattern), evidence, s.drop, depends)

    def _refined_periods(
        self, basis: Basis, patterns: Sequence[CandidatePattern]
    ) -> list[CandidatePattern]:
        """The same oscillations with their periods moved to the best places nearby."""
        trials: list[CandidatePattern] = []
        for pattern in patterns:
            if pattern.wave is not None:
                v, period, along, _ = pattern.wave
                step = 0.25 / (2.0 * v.scale)
                trials += [
                    oscillation(v, 1.0 / (1.0 / period + part * step), pattern.error_motion, along)
                    for part in np.linspace(-1.0, 1.0, _NEARBY)
                ]
        drop = np.zeros(len(trials))
        for s in PatternBank(trials, self._frames).screen(basis):
            drop[s.key] = s.drop
        best = drop.reshape(len(patterns), _NEARBY).argmax(axis=1) if len(patterns) else ()
        return [trials[i * _NEARBY + int(k)] for i, k in enumerate(best)]

    def _distinct(
        self, basis: Basis, found: Sequence[ResidualPattern], most: int
    ) -> list[ResidualPattern]:
        """The strongest first; one that says little beyond those already taken is left out."""
        bank = PatternBank([s.pattern for s in found], self._frames)
        left: dict[int, float] = {}
        taken: list[ResidualPattern] = []
        current = basis
        for key, s in enumerate(found):
            if taken and left.get(key, 0.0) < 0.3 * s.drop:
                continue
            taken.append(s)
            if len(taken) == most:
                break
            current = current.extended(s.columns)
            left = {one.key: one.drop for one in bank.screen(current)}
        return taken


def _shortest(quantities: Sequence[PatternVariable]) -> dict[str, float]:
    """Shortest periods worth trying: a few rows long in time, two steps in position."""
    out: dict[str, float] = {}
    for v in quantities:
        distinct = np.unique(v.value * v.scale)
        steps = np.diff(distinct)
        steps = steps[steps > 1e-9]
        if not len(steps):
            continue
        span = 2.0 * v.scale
        finest = 4.0 * float(np.median(steps)) if v.family == "time" else 2.0 * float(steps.min())
        out[v.name] = max(finest, span / 250.0)
    return out
