"""Set-ups that are no line: ball bar, sphere, R-test, straightness, but for their placing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import Comparison, compare
from abbe.compcore.linalg import svd
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said
from abbe.compcore.verification.fitted import FittedPart
from abbe.compcore.verification.foretold import (
    BY_CHANCE,
    misfit_chance,
    uncertain_parts,
)

F64 = NDArray[np.float64]

_RANK = 1e-9
_FEW = 3
"""Readings in one direction from which on they have a range."""
_AROUND = 6
"""Directions of a set-up from which on they go round, rather than being those of one reading."""
_MORE = 1.05
"""What readings have to grow by, beyond their uncertainty, to be worse."""


@dataclass(frozen=True, eq=False)
class PlacedFigure:
    """What the readings of one set-up show but for how its artefact or instrument stands.

    Attributes
    ----------
    setup, what
        Its name, and what is read, for people.
    rows
        Number of readings after.
    unit
        ``mm`` or ``rad``.
    before, after
        Range of the readings in one direction, the largest of all directions, mm or rad: of a ball
        bar the radial range about the circle that fits best, of a straightness the deviation from
        the line that fits best. `before` None where nobody measured this set-up before; what else
        is of the state before likewise.
    rms_before, rms_after
        Root of the mean square of all of them.
    reading
        Standard uncertainty of one.
    expected
        What readings and the model's own uncertainty would leave of measured less foretold, rms.
    left
        Measured less foretold, rms.
    chance
        Of so large a misfit, if the model holds; None also where nobody states how sure a reading
        is.
    fitted
        What of it the model was fitted to; None: it is new to the model.
    """

    setup: str
    what: str
    rows: int
    unit: str
    before: float | None
    after: float
    rms_before: float | None
    rms_after: float
    reading: float
    expected: float | None
    left: float | None
    chance: float | None
    fitted: FittedPart | None

    @property
    def sd(self) -> float:
        """Standard uncertainty of a range, of two readings."""
        return float(np.sqrt(2.0)) * self.reading

    @property
    def agrees(self) -> bool | None:
        """Whether measured and foretold agree within their uncertainties; None: not known."""
        return None if self.chance is None else self.chance > BY_CHANCE

    @property
    def worse(self) -> bool:
        """Whether the readings show more after than before, beyond their uncertainty."""
        if self.rms_before is None:
            return False
        grown = self.rms_after**2 > self.rms_before**2 + self.reading**2
        return grown and self.rms_after > _MORE * self.rms_before


def placed_figures(
    model: Model,
    campaign: Campaign,
    comparison: Comparison,
    judged: Sequence[str],
    fitted: Mapping[str, FittedPart],
    *,
    measured: bool,
) -> Iterator[PlacedFigure]:
    """The set-ups of a campaign that are neither lines nor calibrated lengths.

    Parameters
    ----------
    campaign
        Measured with the compensation active where `measured`.
    comparison
        The model beside what was measured without compensation, or was put back: the same rows, or
        another campaign, whose set-up of the same name, else the only one that reads the same, is
        the state before.
    judged
        Set-ups that are judged as lines or lengths.
    """
    names = _names(campaign, judged)
    if not names:
        return
    bare = replace(model, terms=(), covariance=None)
    before = _PlacedState.of(compare(bare, comparison.problem.campaign), comparison)
    after = before
    if measured:
        after = _PlacedState.of(compare(bare, campaign))
    elif comparison.problem.campaign.n == campaign.n:
        after = replace(before, residual=comparison.residual)
    known = _names(comparison.problem.campaign, judged)
    for name in names:
        then = after.part(name)
        if then.freedom < 1:
            continue
        alike = [n for n in known if before.part(n).what == then.what]
        alone = sum(after.part(n).what == then.what for n in names) == 1
        earlier = name if name in known else alike[0] if len(alike) == 1 and alone else None
        first = None if earlier is None else before.part(earlier)
        found = PlacedFigure(
            name, then.what, len(then.rows), then.unit, None, then.range, None, then.rms,
            then.reading, None, None, None, fitted.get(name),
        )  # fmt: skip
        yield found if first is None or first.freedom < 1 else _beside(found, model, first)


def _names(campaign: Campaign, judged: Sequence[str]) -> list[str]:
    """Set-ups that are neither judged nor calibrated lengths."""
    setup = campaign.conditions.setup
    names = [] if setup is None else [n for n in campaign.setups if n not in judged]
    if campaign.gauge is None:
        return names
    # a plate's balls are calibrated, too, and lie in a frame of their own: no length by itself
    return [
        n
        for n in names
        if campaign.setups[n].free != ("zero",) or not (campaign.gauge[setup == n] != "").any()
    ]


@dataclass(frozen=True, eq=False)
class _PlacedState:
    """What a campaign shows but for the placing of its set-ups, and the model beside it, if any."""

    comparison: Comparison
    residual: F64
    foretold: Comparison | None = None

    @classmethod
    def of(cls, comparison: Comparison, foretold: Comparison | None = None) -> _PlacedState:
        return cls(comparison, comparison.residual, foretold)

    def part(self, name: str) -> _PlacedPart:
        setup = self.comparison.problem.campaign.conditions.setup
        return _PlacedPart(self, np.flatnonzero(setup == name))


@dataclass(frozen=True, eq=False)
class _PlacedPart:
    """The rows of one set-up."""

    state: _PlacedState
    rows: NDArray[np.intp]

    @cached_property
    def left(self) -> F64:
        """Orthonormal directions of its placing, weighted."""
        found = self.state.foretold or self.state.comparison
        standing = found.problem.jacobian(found.theta)[:, found.problem.layout.model_size :]
        return _basis(standing[self.rows])

    @property
    def campaign(self) -> Campaign:
        return self.state.comparison.problem.campaign.rows(self.rows)

    @property
    def freedom(self) -> int:
        return int(len(self.rows) - self.left.shape[1])

    @property
    def sd(self) -> F64:
        return self.state.comparison.problem.sd[self.rows]

    @property
    def what(self) -> str:
        return _what(self.campaign)

    @property
    def unit(self) -> str:
        turned = bool((self.campaign.kind == Kind.ROTATION).all())
        return "rad" if turned else "mm"

    @property
    def range(self) -> float:
        return _range(self.campaign, self.state.residual[self.rows])

    @property
    def rms(self) -> float:
        return _rms(self.state.residual[self.rows])

    @property
    def reading(self) -> float:
        return float(np.median(self.sd))


def _beside(found: PlacedFigure, model: Model, first: _PlacedPart) -> PlacedFigure:
    """A set-up with what it was before, and what the model says of that."""
    comparison = first.state.foretold
    assert comparison is not None  # noqa: S101 - a state before has one
    weight, left = 1.0 / first.sd, first.left
    seen = uncertain_parts(model, first.campaign) * weight[:, None]
    seen = seen - left @ (left.T @ seen)
    misfit = comparison.residual[first.rows]
    variance = (1.0 - (left**2).sum(axis=1) + (seen**2).sum(axis=1)) / weight**2
    stated = not comparison.uncertainty.open and model.covariance is not None
    return replace(
        found,
        before=first.range,
        rms_before=first.rms,
        reading=max(found.reading, first.reading),
        expected=float(np.sqrt(np.mean(variance))),
        left=_rms(misfit),
        chance=misfit_chance(misfit * weight, seen, first.freedom) if stated else None,
    )


def _basis(columns: F64) -> F64:
    """Orthonormal directions of the columns, (n, k)."""
    columns = columns[:, np.abs(columns).max(axis=0, initial=0.0) > 0.0]
    if not columns.shape[1]:
        return columns
    left, size, _ = svd(columns / np.linalg.norm(columns, axis=0))
    return np.asarray(left[:, size > _RANK * size[0]])


def _range(rows: Campaign, values: F64) -> float:
    """The largest range of readings in one direction, or from one base point.

    Where a ball bar goes round each reading has a direction of its own: all are radial.
    """
    u, base = rows.conditions.u, rows.conditions.base
    seen: list[tuple[object, ...]] = [
        (int(k), *(() if u is None else np.round(u[i], 3) + 0.0), "" if base is None else base[i])
        for i, k in enumerate(rows.kind)
    ]
    if len(set(seen)) > _AROUND:
        seen = [(k, "") for k, *_ in seen]
    groups: dict[tuple[object, ...], list[float]] = {}
    for key, value in zip(seen, values, strict=True):
        groups.setdefault(key, []).append(float(value))
    usable = [g for g in groups.values() if len(g) >= _FEW] or [[float(v) for v in values]]
    return max(max(g) - min(g) for g in usable)


def _what(rows: Campaign) -> str:
    kinds = {Kind(int(k)) for k in rows.kind}
    free = (
        rows.setups[str(rows.conditions.setup[0])].free if rows.conditions.setup is not None else ()
    )
    if kinds <= {Kind.DISTANCE, Kind.BASE_DISTANCE}:
        return said("distances from a base point")
    if kinds == {Kind.ROTATION}:
        return said("angles")
    return said("deviations from a straight line") if "slope" in free else said("displacements")


def _rms(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2)))
