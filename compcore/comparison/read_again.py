"""What held-out campaigns leave where fitted ones were read: lacking in the model, or changed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Campaign, Kind
from abbe.compcore.campaign.overlap import SAME_TARGET, met_again
from abbe.compcore.comparison.compare import Comparison
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_FEWEST_PLACES = 8
_SHARE = 0.5
"""Part of the held-out rows that have to lie where fitted ones were read."""
_VISITS = 8
"""Readings of one place at most of which the mean is taken."""
_MORE = 1.2
"""Times what the fitted rows leave from which on there is something to explain."""
_SURE = 2.0
_OTHER = 3.0
"""Times what the fitted campaigns differ by among themselves: others read otherwise by more."""


@dataclass(frozen=True)
class ReadAgain:
    """What a held-out campaign leaves at places that the fitted campaigns show as well.

    What both leave there alike is an error of the machine that the model lacks; the rest is no
    matter of where the machine stands: something changed between them, or it is noise.

    Attributes
    ----------
    rows, of
        Held-out rows that were read where fitted ones were, and all of them, of one kind.
    left
        RMS of what the model leaves of the former, mm or rad.
    lacking
        RMS of the part that the fitted campaigns leave there, too, mm or rad; 0 where none surely.
    between
        RMS by which they read otherwise there than the mean of the fitted ones, mm or rad.
    among
        Standard deviation of the fitted ones among themselves there, mm or rad; None where they
        were read once.
    rotations
        Whether rad.
    """

    rows: int
    of: int
    left: float
    lacking: float
    between: float = 0.0
    among: float | None = None
    rotations: bool = False

    @property
    def otherwise(self) -> bool:
        """Whether the fitted campaigns agree with each other, and held-out ones not with them."""
        return self.among is not None and self.between > _OTHER * self.among

    @property
    def changed(self) -> float:
        """RMS of the other part, mm or rad."""
        return math.sqrt(max(self.left**2 - self.lacking**2, 0.0))

    def words(self) -> Iterator[str]:
        """One sentence."""
        unit, factor = ("µrad", 1e6) if self.rotations else ("µm", 1e3)
        left, lacking, changed, between, among = (
            f"{in_digits(v * factor)} {unit}"
            for v in (self.left, self.lacking, self.changed, self.between, self.among or 0.0)
        )
        if self.otherwise:
            yield said(
                "{rows} of {of} held-out rows were read where fitted ones were, and read otherwise "
                "by {between}; the fitted ones differ by {among} among themselves: between them "
                "something was changed (clamped anew, exchanged, adjusted, a crash), or it was as "
                "much warmer or heavier. No model of the fitted campaigns foretells it: fit to "
                "what was measured since",
                rows=str(self.rows),
                of=str(self.of),
                between=between,
                among=among,
            )
            return
        if not self.lacking:
            yield said(
                "{rows} of {of} held-out rows were read where fitted ones were: of the {left} left "
                "there nothing surely stands in the fitted campaigns, too. The machine changed "
                "between them (temperature, load, a part exchanged), or it is noise: another error "
                "of position would not foretell it",
                rows=str(self.rows),
                of=str(self.of),
                left=left,
            )
            return
        yield said(
            "{rows} of {of} held-out rows were read where fitted ones were: of the {left} left "
            "there {lacking} stands in the fitted campaigns, too, and is lacking in the model; "
            "{changed} does not: the machine changed between them (temperature, load, a part "
            "exchanged), or it is noise",
            rows=str(self.rows),
            of=str(self.of),
            left=left,
            lacking=lacking,
            changed=changed,
        )


def read_again(fitted: FitResult, beside: Comparison, *, rotations: bool) -> ReadAgain | None:
    """Lay what a model leaves of a held-out campaign beside what it leaves of the fitted ones.

    The mean product of both at the same place (axes, sides of approach, tool, measured component)
    is the variance of what they have in common, whatever noise either has.

    Parameters
    ----------
    fitted
        The fit.
    beside
        Its model beside the campaign that was not fitted.
    rotations
        Whether angles are looked at, and not displacements.

    Returns
    -------
    None where too few rows were read at the same places; where no more is left than of the fitted
    rows, and what is read agrees with them.
    """
    one, two = fitted.problem.campaign, beside.problem.campaign
    mine, theirs = (_kind(c, rotations=rotations) for c in (one, two))
    of = int(theirs.sum())
    if not of or not mine.any():
        return None
    at = np.column_stack([np.round(q[mine], 3) for q in one.conditions.positions.values()])
    if len(np.unique(at, axis=0)) < _FEWEST_PLACES:
        return None  # of thousands of rows at one place each would be asked for all others
    known, seen = fitted.residual[mine], beside.residual[theirs]
    met = met_again(one.rows(mine), two.rows(theirs), SAME_TARGET, _VISITS)
    rows = np.array([len(m) > 0 for m in met])
    places = {tuple(np.sort(m).tolist()) for m in met if len(m)}
    if len(places) < _FEWEST_PLACES or rows.sum() < _SHARE * of:
        return None
    there = np.array([float(known[m].mean()) for m in met if len(m)])
    left = seen[rows]
    common = left * there
    mean = float(common.mean())
    sure = mean > _SURE * float(common.std(ddof=1)) / math.sqrt(len(places))
    found = ReadAgain(
        int(rows.sum()),
        of,
        _rms(left),
        min(math.sqrt(mean), _rms(left)) if sure else 0.0,
        _rms(left - there),
        _among([known[list(place)] for place in places]),
        rotations,
    )
    return found if found.otherwise or found.left > _MORE * _rms(known) else None


def _among(places: list[F64]) -> float | None:
    """Standard deviation of readings of the same places; None where too few were read twice."""
    freedom = sum(len(p) - 1 for p in places)
    if freedom < _FEWEST_PLACES:
        return None
    return math.sqrt(sum(float(np.sum((p - p.mean()) ** 2)) for p in places) / freedom)


def _kind(campaign: Campaign, *, rotations: bool) -> NDArray[np.bool_]:
    return np.isin(campaign.kind, (Kind.ROTATION,) if rotations else LENGTHS)


def _rms(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2)))
