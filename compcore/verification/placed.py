"""Set-ups that are no line: ball bar, sphere, R-test, straightness, but for their placing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import Comparison, compare
from abbe.compcore.linalg import svd
from abbe.compcore.model.model import Model
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
        Number of readings.
    unit
        ``mm`` or ``rad``.
    before, after
        Range of the readings in one direction, the largest of all directions, mm or rad: of a ball
        bar the radial range about the circle that fits best, of a straightness the deviation from
        the line that fits best.
    rms_before, rms_after
        Root of the mean square of all of them.
    reading
        Standard uncertainty of one.
    expected
        What readings and the model's own uncertainty would leave of measured less foretold, rms.
    left
        Measured less foretold, rms.
    chance
        Of so large a misfit, if the model holds; None where nobody states how sure a reading is.
    fitted
        What of it the model was fitted to; None: it is new to the model.
    """

    setup: str
    what: str
    rows: int
    unit: str
    before: float
    after: float
    rms_before: float
    rms_after: float
    reading: float
    expected: float
    left: float
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
        Measured with the compensation active where `measured`; the same rows as `comparison`'s.
    comparison
        The model beside what was measured without compensation, or was put back.
    judged
        Set-ups that are judged as lines or lengths.
    """
    setup = campaign.conditions.setup
    names = [] if setup is None else [n for n in campaign.setups if n not in judged]
    if campaign.gauge is not None:
        names = [n for n in names if not (campaign.gauge[setup == n] != "").any()]
    if not names:
        return
    problem = comparison.problem
    bare = replace(model, terms=(), covariance=None)
    before = compare(bare, problem.campaign).residual
    after = compare(bare, campaign).residual if measured else comparison.residual
    standing = problem.jacobian(comparison.theta)[:, problem.layout.model_size :]
    for name in names:
        rows = np.flatnonzero(setup == name)
        left = _basis(standing[rows])
        freedom = len(rows) - left.shape[1]
        if freedom < 1:
            continue
        part, weight = problem.campaign.rows(rows), 1.0 / problem.sd[rows]
        seen = uncertain_parts(model, part) * weight[:, None]
        seen = seen - left @ (left.T @ seen)
        misfit = comparison.residual[rows] * weight
        variance = (1.0 - (left**2).sum(axis=1) + (seen**2).sum(axis=1)) / weight**2
        stated = not comparison.uncertainty.open and model.covariance is not None
        turned = bool((campaign.kind[rows] == Kind.ROTATION).all())
        yield PlacedFigure(
            name,
            _what(part),
            len(rows),
            "rad" if turned else "mm",
            _range(part, before[rows]),
            _range(part, after[rows]),
            _rms(before[rows]),
            _rms(after[rows]),
            float(np.median(problem.sd[rows])),
            float(np.sqrt(np.mean(variance))),
            _rms(comparison.residual[rows]),
            misfit_chance(misfit, seen, freedom) if stated else None,
            fitted.get(name),
        )


def _basis(columns: F64) -> F64:
    """Orthonormal directions of the columns, (n, k)."""
    columns = columns[:, np.abs(columns).max(axis=0, initial=0.0) > 0.0]
    if not columns.shape[1]:
        return columns
    left, size, _ = svd(columns / np.linalg.norm(columns, axis=0))
    return np.asarray(left[:, size > _RANK * size[0]])


def _range(rows: Campaign, values: F64) -> float:
    """The largest range of readings in one direction, or from one base point."""
    u, base = rows.conditions.u, rows.conditions.base
    seen = [
        (int(k), *(() if u is None else np.round(u[i], 3) + 0.0), "" if base is None else base[i])
        for i, k in enumerate(rows.kind)
    ]
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
        return "distances from a base point"
    if kinds == {Kind.ROTATION}:
        return "angles"
    return "deviations from a straight line" if "slope" in free else "displacements"


def _rms(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2)))
