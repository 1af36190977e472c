"""Identification of a controller's convention from points with its correction on and off.

All combinations are screened to first order (`screening`); the best, and everything that differs
from the best in one respect, are then computed exactly and ranked. What the points cannot tell
apart is said, with a pose that would.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError, require_type
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention
from abbe.compcore.maps.conventions.hypotheses import (
    Hypothesis,
    named_points,
    own_travels,
    structures,
)
from abbe.compcore.maps.conventions.point_fit import PointFit, fit_rotation_point
from abbe.compcore.maps.conventions.ranking import FLOOR, RankedHypothesis, Ranking, Tie
from abbe.compcore.maps.conventions.screening import frame, frames, screen, unseen_columns
from abbe.compcore.maps.conventions.subject import Source, Subject
from abbe.compcore.maps.conventions.switched import SwitchedPoints
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]
Verdict = Literal["identified", "ambiguous", "none"]

_EXACTLY, _ESTIMATED = 50, 8
"""Hypotheses with a named and with an estimated rotation point that are computed exactly, besides
those that differ from the best in one respect.
"""
_SCREENED_POINTS = 1500


@dataclass(frozen=True)
class Identification:
    """The result of an identification: verdict, best hypothesis, ranking, what would decide.

    Attributes
    ----------
    verdict
        ``identified``: one convention reproduces the points (others at most differ where a tool
        is offset, see `ties`); ``ambiguous``: several do that other points would tell apart;
        ``none``: not even the best one reproduces them.
    ranking
        All hypotheses computed exactly, best first.
    changes
        The best with one thing changed, worst first: what the points rule out, and how clearly.
    ties
        Others as good as the best, simplest first; `twin` and an estimated rotation point that
        agrees with a named one apart.
    twin
        What the same points mean if an artefact was measured instead of switching the correction
        on and off, or the other way round; None where both readings are in the file.
    unseen
        Columns of the map that do next to nothing at these points: their signs are open.
    point
        Rotation point estimated by least squares for the best signs and chain.
    observed_rms, tolerance, sigma
        RMS of the differences, what counts as reproducing them, their rounding; mm.
    gain
        Factor by which the best prediction, without its sign of measuring, fits: 1, or −1.
    """

    verdict: Verdict
    stated: Structure
    n: int
    ranking: tuple[RankedHypothesis, ...]
    changes: tuple[RankedHypothesis, ...]
    ties: tuple[Tie, ...]
    twin: Hypothesis | None
    unseen: tuple[Source, ...]
    point: PointFit
    observed_rms: float
    tolerance: float
    sigma: float
    both_read: bool
    gain: float = field(default=1.0)

    @property
    def best(self) -> RankedHypothesis:
        """The simplest of the hypotheses with the least residual."""
        return self.ranking[0]

    @property
    def opposite(self) -> bool:
        """Whether the linear errors appear with the opposite sign, artefact or not."""
        c = self.best.hypothesis
        signs = [c.convention.sign(a, k) for a in self.stated.linear for k in "XYZ"]
        return bool(sum(signs) * (-1.0 if c.artefact else 1.0) < 0.0)


def identify(
    subject: Subject,
    points: SwitchedPoints,
    structure: Structure,
    *,
    any_order: bool = False,
    tolerance: float | None = None,
) -> Identification:
    """Identify the convention that reproduces a controller's correction at measured points.

    Parameters
    ----------
    subject
        The map or the model.
    points
        Where the correction was read on and off.
    structure
        The machine's structure; with `any_order` other orders of its axes are tried too.
    tolerance
        RMS in mm up to which a hypothesis reproduces the points; where None three times the
        rounding, 0.1 µm or 0.5 % of the differences, whichever is most.

    Raises
    ------
    InputError
        When there are too few points, no differences to explain, or nothing that could.
    """
    require_type(points, SwitchedPoints, "points")
    require_type(structure, Structure, "structure")
    observed = float(np.sqrt(np.mean(points.difference**2)))
    if points.n < 3:
        raise InputError("too few points", found=points.n, expected="at least 3, better 30")
    if observed <= max(2.0 * points.sigma, FLOOR):
        raise InputError(
            "the correction does nothing at these points: on and off read alike",
            found=f"{in_digits(observed * 1e3)} µm RMS",
            expected="differences above the display's last digit",
        )
    if tolerance is None:
        tolerance = max(3.0 * points.sigma, 1e-4, 0.005 * observed)
    declared = any(any(a.rotation_point) for a in subject.machine(structure).axes.values())
    few = points.thinned(_SCREENED_POINTS)
    bare = subject.machine(structure)
    if not any(subject.parts(bare, forms, few.conditions) for forms in subject.forms()):
        raise InputError(
            "corrects nothing at these points",
            expected="a map with numbers other than 0, or a model that was fitted",
        )
    ranking = Ranking(subject, points, structure)
    for h in _likely(subject, few, structure, any_order, declared):
        ranking.judge(ranking.refined(h))
    ranking.judge(Hypothesis(structure, Convention(rotation_point=None if declared else {})))

    def changed(best: RankedHypothesis) -> list[RankedHypothesis]:
        others = _one_changed(best.hypothesis, subject, points, any_order, declared)
        return [ranking.judge(h) for h in others]

    best = ranking.best()
    changes = changed(best)
    if (better := ranking.best()) != best:  # exact composition may overturn a close first order
        best = better
        changes = changed(best)
    ties = ranking.ties(best)
    h = best.hypothesis
    return Identification(
        _verdict(best, ties, tolerance),
        structure,
        points.n,
        tuple(ranking.ranking()),
        tuple(sorted((j for j in _once(changes) if j is not best), key=lambda j: -j.rms)),
        tuple(ties),
        None if points.both_read else h.twin(),
        tuple(sorted(unseen_columns(frame(subject, few, h.structure, h.convention), few))),
        fit_rotation_point(subject, points, h),
        observed,
        tolerance,
        points.sigma,
        points.both_read,
        ranking.gain(h),
    )


def _likely(
    subject: Subject, points: SwitchedPoints, structure: Structure, any_order: bool, declared: bool
) -> list[Hypothesis]:
    """The hypotheses that fit best to first order, with named and with estimated points."""
    screened = [
        s
        for f in frames(subject, points, structure, any_order)
        for s in screen(f, points, declared=declared)
    ]
    screened.sort(key=lambda s: s.rss)
    estimated = [s.hypothesis for s in screened if s.hypothesis.fitted_point]
    named = [s.hypothesis for s in screened if not s.hypothesis.fitted_point]
    return [*named[:_EXACTLY], *estimated[:_ESTIMATED]]


def _verdict(best: RankedHypothesis, ties: Sequence[Tie], tolerance: float) -> Verdict:
    if best.rms > tolerance:
        return "none"
    # ties that only a tool's offset would tell apart do not make it ambiguous
    if any(t.telling is not None and not any(t.telling.tool) for t in ties):
        return "ambiguous"
    return "identified"


def _once(judged: list[RankedHypothesis]) -> list[RankedHypothesis]:
    return list({id(j): j for j in judged}.values())


def _one_changed(
    best: Hypothesis, subject: Subject, points: SwitchedPoints, any_order: bool, declared: bool
) -> Iterator[Hypothesis]:
    """Everything that differs from a hypothesis in one respect."""
    c, machine = best.convention, subject.machine(best.structure)
    axes = best.structure.linear
    linear = frozenset((a, k) for a in axes for k in "XYZ")
    angular = frozenset((a, k) for a in axes for k in "ABC")
    groups = [linear, angular]
    groups += [frozenset(s for s in angular if s[1] == k) for k in "ABC"]
    groups += [frozenset(s for s in some if s[0] == a) for a in axes for some in (linear, angular)]
    for group in groups:
        yield replace(best, convention=replace(c, reversed=c.reversed ^ group))
    for own in own_travels(machine):
        yield replace(best, convention=replace(c, own_travel=own))
    for form, stated in subject.forms():
        yield replace(best, convention=replace(c, squareness=form, stated=stated))
    for point in named_points(c.on(machine), declared):
        moved = replace(c, rotation_point=point)
        yield replace(best, convention=moved, fitted_point=False)
    if not points.both_read:
        yield replace(best, artefact=not best.artefact)
    for structure in structures(best.structure, any_order):
        yield replace(best, structure=structure)
