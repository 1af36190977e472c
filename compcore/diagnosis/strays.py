"""Readings that stand alone: misread, bumped or mistyped, and no work of a cause.

A cause shows in many rows: in neighbouring places, in the readings before and after, each time that
the machine comes to a place. A single reading that is off by more than chance, and that none of
these shares, is a mirror that was bumped or a digit that was mistyped. Least squares give it the
weight of its square, so that it drives causes into a model, or hides those that are there. Such
rows are set aside, named by file and line, and asked for again; none is changed or taken out of a
file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import clock_order
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.distributions import normal_limit
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.robust import studentised
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import display, in_digits

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_CHANCE = 1e-3
"""Probability that any of n normal residuals is taken for a stray."""
_SHARED = 0.5
"""Part of a row's residual from which on another row shares it."""
_MOST = 0.1
"""Greatest part of a set-up's rows that may be strays: what is off more often is no stray."""
_APART = 2.0
"""So many times as far off as the furthest of all others a stray is."""
_MOST_OF_ALL = 0.01
"""Greatest part of a campaign's rows that are set aside at a time."""
_ALONE = 0.5
"""Part of all that a cause explains above which it stands on one row."""
_DECIMALS = 2
"""Of mm, and of rad ten times finer: what a machine that returns to a place does not repeat."""


@dataclass(frozen=True)
class Stray:
    """A reading that nothing measured beside it agrees with.

    Attributes
    ----------
    file, line
        Where it stands.
    setup
        Its set-up; empty where there is none.
    rotation
        Whether it is a rotation.
    off
        Measured less what the model says that is fitted to all others, mm or rad.
    size
        The same in standard deviations.
    """

    file: str
    line: int
    setup: str
    rotation: bool
    off: float
    size: float

    @property
    def text(self) -> Sentence:
        """For people: where it stands, and how far off it is."""
        unit, factor = display("rad" if self.rotation else "mm")
        return said(
            "{file}, line {line}, set-up {setup}: off by {off} {unit}, {size} standard deviations",
            file=self.file,
            line=self.line,
            setup=self.setup,
            off=in_digits(self.off * factor, sign=True),
            unit=unit,
            size=f"{self.size:.0f}",
        )


def strays(
    result: FitResult, before: Basis, beside: Basis, signatures: Sequence[F64]
) -> dict[int, Stray]:
    """The readings that stand alone beside what a diagnosis found.

    Those that neither the model nor the causes nor a description explain, and those that are all
    that one of these explains.

    Parameters
    ----------
    result
        The fit of the model as it is.
    before, beside
        What it leaves without what was found, and with it.
    signatures
        What each cause or description explains of every row, mm or rad, each of shape (n,).

    Returns
    -------
    Row of the fit → what is said of it.
    """
    problem = result.problem
    beside_which = _Neighbours(problem.campaign)
    found = _apart(problem, before, beside_which) or _apart(problem, beside, beside_which)
    explained = [s * problem.weight for s in signatures]
    size = _sizes(problem, before.residual, _absorbed(before)) if explained else np.zeros(0)
    for s in explained:
        row = int(np.argmax(np.abs(s)))
        leads = s[row] ** 2 > _ALONE * float(s @ s) and abs(size[row]) > _limit(problem)
        shared = beside_which.comes_again(row, size) or beside_which.goes_on(row, size[row], size)
        if leads and not shared:
            found.setdefault(row, float(size[row]))
    campaign = problem.campaign
    setup = campaign.conditions.setup
    others = before.residual / (problem.weight * np.maximum(1.0 - _absorbed(before), 1e-3))
    return {
        row: Stray(
            campaign.file_of(row),
            int(campaign.line[row]),
            "" if setup is None else str(setup[row]),
            bool(campaign.kind[row] == Kind.ROTATION),
            float(others[row]),
            abs(size),
        )
        for row, size in found.items()
    }


def _limit(problem: Problem) -> float:
    """The size that chance hardly ever exceeds, in standard deviations."""
    return normal_limit(_CHANCE / (2.0 * max(problem.n, 1)))


def _sizes(problem: Problem, weighted: F64, absorbed: F64) -> F64:
    """Weighted residuals in their own standard deviations, shape (n,); 0 where not used."""
    used = problem.weight > 0.0
    residual = np.where(used, weighted / np.where(used, problem.weight, 1.0), 0.0)
    return studentised(problem, residual, absorbed)


def _apart(problem: Problem, basis: Basis, beside: _Neighbours) -> dict[int, float]:
    """Rows that are far from all others and alone where they were measured, and their size.

    One after the other the furthest is left out of the fit, until what is left is nearer by a
    factor: so neither does one hide another, nor do its neighbours seem to be off that it pulls at.
    """
    limit = _limit(problem)
    left, absorbed = basis.residual.copy(), _absorbed(basis)
    grown: list[F64] = []
    out: dict[int, float] = {}
    most = max(1, round(_MOST_OF_ALL * problem.n))
    while True:
        size = _sizes(problem, left, absorbed)
        row = int(np.argmax(np.abs(size)))
        if out and min(map(abs, out.values())) > _APART * abs(size[row]):
            break
        if abs(size[row]) <= limit or len(out) == most:
            return {}
        out[row] = float(size[row])
        hat = _hat(basis, row) + sum((v * v[row] for v in grown), np.zeros(problem.n))
        keep = max(1.0 - float(hat[row]), 1e-9)
        left = left + hat * (left[row] / keep)
        grown.append(hat / np.sqrt(keep))
        absorbed = absorbed + grown[-1] ** 2
        absorbed[row] = 1.0
    every = size.copy()
    every[list(out)] = list(out.values())
    found = {
        row: own
        for row, own in out.items()
        if not beside.comes_again(row, every) and not beside.goes_on(row, own, size)
    }
    for rows in beside.lines:
        own_rows = found.keys() & set(rows.tolist())
        if len(own_rows) > max(1.0, _MOST * len(rows)):
            found = {row: own for row, own in found.items() if row not in own_rows}
    return found


def _hat(basis: Basis, row: int) -> F64:
    """How much of a reading each row's fitted value follows, shape (n,)."""
    out = basis.q @ basis.q[row] + basis.extra @ basis.extra[row]
    for rows, own in basis.eliminator.bases():
        at = np.flatnonzero(rows == row)
        if len(at):
            out[rows] += own @ own[at[0]]
    return np.asarray(out)


def _absorbed(basis: Basis) -> F64:
    """How much of a reading the model and its set-up's zero follow by themselves, shape (n,)."""
    out = np.sum(basis.q**2, axis=1) + np.sum(basis.extra**2, axis=1)
    for rows, own in basis.eliminator.bases():
        out[rows] += np.sum(own**2, axis=1)
    return np.asarray(out)


class _Neighbours:
    """Which rows were measured beside which: before and after, next to it, at the same place."""

    def __init__(self, campaign: Campaign) -> None:
        conditions = campaign.conditions
        n = campaign.n
        u = np.zeros((n, 3)) if conditions.u is None else np.round(conditions.u, 3)
        what = np.column_stack([campaign.kind, u])
        if conditions.base is not None:
            base = np.unique(conditions.base, return_inverse=True)[1].reshape(-1)
            what = np.column_stack([what, base])
        at = np.column_stack(
            [
                np.zeros(n),
                *(v * (10.0 if is_rotary(a) else 1.0) for a, v in conditions.positions.items()),
            ]
        )
        place = np.column_stack([what, np.round(at, _DECIMALS), np.round(conditions.tool, 1)])
        extent = np.ptp(at, axis=0)
        self._at = at / np.where(extent > 0.0, extent, 1.0)
        self._place = _groups(place)
        setup = np.zeros(n, dtype="<U1") if conditions.setup is None else conditions.setup
        line = _groups(np.column_stack([what, _groups(setup[:, None])]))
        # where each row was measured along another direction, all of a set-up are one line
        few = np.bincount(line)[line] < 3
        line = np.where(few, line.max() + 1 + _groups(setup[:, None]), line)
        self._line = line
        order = clock_order(conditions)
        self.lines = [
            rows[np.argsort(order[rows], kind="stable")]
            for rows in (np.flatnonzero(line == k) for k in np.unique(line))
        ]

    def comes_again(self, row: int, size: F64) -> bool:
        """Whether the place's other visits, half of them or more, are off as a row is.

        Those of its own set-up, where there are any: of what an axis does another set-up sees
        nothing in which that axis rests.
        """
        same = np.flatnonzero(self._place == self._place[row])
        same = same[same != row]
        own = same[self._line[same] == self._line[row]]
        others = own if len(own) else same
        alike = size[others] * np.sign(size[row]) > _SHARED * abs(size[row])
        return bool(len(others)) and float(np.mean(alike)) >= 0.5

    def goes_on(self, row: int, own: float, size: F64) -> bool:
        """Whether a reading before, after or next to a row of this size is off as it is."""
        rows = next(rows for rows in self.lines if row in rows)
        k = int(np.flatnonzero(rows == row)[0])
        beside = [*rows[max(0, k - 1) : k], *rows[k + 1 : k + 2]]
        further = rows[self._place[rows] != self._place[row]]
        if len(further):
            away = np.linalg.norm(self._at[further] - self._at[row], axis=1)
            beside += list(further[np.argsort(away, kind="stable")[:2]])
        alike = size[np.array(beside, dtype=np.int64)] * np.sign(own) > _SHARED * abs(own)
        return not beside or bool(alike.any())


def _groups(columns: NDArray[np.generic]) -> I64:
    """The number of the group of equal rows that each row belongs to, shape (n,)."""
    return np.asarray(np.unique(columns, axis=0, return_inverse=True)[1].reshape(-1))
