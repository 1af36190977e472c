"""Cross-validation by whole blocks: does an added cause predict unseen data?

Residuals are correlated within a set-up, in time and by place, so rows are never left out one by
one. The set-ups are dealt, in order of time, into folds; a set-up that runs through the day (a
master point revisited) is cut into as many blocks of time. Where there are too few set-ups to leave
one out, each is cut into stretches of time, or, where no clock ran, into neighbouring places: so
narrow, where a shape is judged by them, that its knots lie no closer than they are wide. What lies
further from all that was measured no shape of such detail can foretell, however true it is.

Where one set-up alone shows a cause (a line that is measured once, as most are), none foretells it:
that set-up is cut too, and the cause is judged by its parts (`cut_alone`).

Leaving a fold out is exact and needs no refit: with H = QQᵀ the hat matrix, the residuals of
left-out rows B are ``(I − H_BB)⁺ r_B``. What only the left-out rows determine (their own zero, a
line measured once) is fitted to them, as in use.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.alike import alike
from abbe.compcore.diagnosis.screening.left_out.repeated_places import visits
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

FOLDS = 8


def folds(
    conditions: Conditions, count: int = FOLDS, *, detail: Mapping[str, float] | None = None
) -> list[Index]:
    """Row indices of each fold, in order.

    Parameters
    ----------
    conditions
        The rows: set-up, time and run, and the positions where no clock ran.
    count
        Number of folds; fewer where there are fewer rows.
    detail
        Axis → distance of the knots of a shape that is judged, mm or rad: stretches of few set-ups
        are cut until they are no wider. Where the campaign is too coarse for that, as without.
    """
    usual = found = _dealt(conditions, count, 1)
    finer = 1
    while not all(_near(conditions, found, axis, h) for axis, h in (detail or {}).items()):
        finer *= 2
        before, found = found, _dealt(conditions, count, finer)
        if all(map(np.array_equal, before, found)):
            return usual
    return found


def cut_alone(
    conditions: Conditions,
    parts: Sequence[Index],
    alone: Sequence[int],
    count: int = FOLDS,
    *,
    detail: Mapping[str, float] | None = None,
) -> list[Index]:
    """Folds of which some are cut, each of their set-ups into so many stretches.

    Parameters
    ----------
    conditions
        The rows.
    parts
        The rows of each fold.
    alone
        Which of them show something that no other does.
    count
        Folds that each of these becomes.
    detail
        As of `folds`.
    """

    def cut(finer: int) -> list[Index]:
        found = [rows for i, rows in enumerate(parts) if i not in alone]
        order = clock_order(conditions)
        for i in alone:
            dealt: list[list[Index]] = [[] for _ in range(count)]
            for own in setup_rows(conditions.rows(parts[i])):
                rows = parts[i][own]
                rows = rows[np.argsort(order[rows], kind="stable")]
                pieces = max(1, min(count * finer, len(rows) // 2))
                for k, piece in enumerate(_stretches(conditions, rows, pieces)):
                    dealt[k % count].append(piece)
            found += [np.sort(np.concatenate(rows)) for rows in dealt if rows]
        return found

    usual = found = cut(1)
    finer = 1
    while not all(_near(conditions, found, axis, h) for axis, h in (detail or {}).items()):
        finer *= 2
        before, found = found, cut(finer)
        if all(map(np.array_equal, before, found)):
            return usual
    return found


def _near(conditions: Conditions, parts: Sequence[Index], axis: str, distance: float) -> bool:
    """Whether rows that are left out have others about a quarter of a distance away along an axis.

    So far away they are, in the median, where stretches are as wide as the distance.
    """
    at = conditions.position(axis)
    away = []
    for rows in parts:
        others = np.sort(np.delete(at, rows))
        if not len(others):
            return True
        above = np.clip(np.searchsorted(others, at[rows]), 1, len(others) - 1)
        between = np.abs(others[[above - 1, above]] - at[rows])
        away.append(between.min(axis=0))
    return float(np.median(np.concatenate(away))) <= 0.25 * distance


def _dealt(conditions: Conditions, count: int, finer: int) -> list[Index]:
    """The folds, with stretches of few set-ups cut into so many more."""
    n = conditions.n
    order = clock_order(conditions)
    own = setup_rows(conditions)
    blocks: list[tuple[float, Index]] = []
    few = len(own) < count
    for rows in own:
        rows = rows[np.argsort(order[rows], kind="stable")]
        extent = np.ptp(order[rows]) + 1
        if few:
            pieces = math.ceil(2 * count * len(rows) / n) * finer
            pieces = max(1, min(pieces, len(rows) // 2))
            parts = _stretches(conditions, rows, pieces)
        elif extent > 4 * len(rows) and len(rows) >= 2 * count:
            # a set-up spread over much more of the clock than its own rows is cut by time
            parts = np.array_split(rows, count)
        else:
            parts = [rows]
        blocks += [(float(order[p].mean()), p) for p in parts if len(p)]
    blocks.sort(key=lambda block: block[0])
    used = min(count, len(blocks))
    dealt: list[list[Index]] = [[] for _ in range(used)]
    for i, (_, rows) in enumerate(blocks):
        dealt[i % used].append(rows)
    return [np.sort(np.concatenate(fold)) for fold in dealt]


def _stretches(conditions: Conditions, rows: Index, pieces: int) -> list[Index]:
    """Rows of a set-up, in order of time, as stretches of time; without a clock as places."""
    if np.ptp(conditions.time[rows]) > 0.0:
        return np.array_split(rows, pieces)
    return visits(conditions, rows) or _by_place(conditions, rows, pieces)


def clock_order(conditions: Conditions) -> F64:
    """The rank of each row in run and time, shape (n,)."""
    n = conditions.n
    run = np.zeros(n) if conditions.run is None else conditions.run
    order = np.empty(n)
    order[np.lexsort((conditions.time, run))] = np.arange(n)
    return order


def setup_rows(conditions: Conditions) -> list[Index]:
    """The rows of each set-up."""
    names = np.zeros(conditions.n, dtype="<U1") if conditions.setup is None else conditions.setup
    return alike(names)


def _by_place(conditions: Conditions, rows: Index, pieces: int) -> list[Index]:
    """Rows as neighbouring places, halved again and again across the longest extent.

    Rows of one place stay together. Where all are of one, what was recorded there stands for the
    places: with them left out together nothing would be left to foretell them from.
    """
    shown = [v[rows] for v in conditions.positions.values()]
    if not any(np.ptp(v) > 0.0 for v in shown):
        shown = [v[rows] for v in conditions.signals.values()]
    if not shown:
        return [rows]
    places = np.column_stack(shown)
    extent = np.ptp(places, axis=0)
    places = places / np.where(extent > 0.0, extent, 1.0)
    return [rows[part] for part in _halved(places, np.arange(len(rows)), pieces)]


def _halved(places: F64, part: Index, pieces: int) -> Iterator[Index]:
    extent = np.ptp(places[part], axis=0) if len(part) else np.zeros(1)
    if pieces < 2 or float(extent.max(initial=0.0)) <= 0.0:
        yield part
        return
    along = places[part, int(np.argmax(extent))]
    middle = float(np.median(along))
    low = along <= middle if (along > middle).any() else along < middle
    yield from _halved(places, part[low], pieces - pieces // 2)
    yield from _halved(places, part[~low], pieces // 2)


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What a model leaves of blocks that are left out of its fit, each in its turn.

    Attributes
    ----------
    residual
        Of each row, as the fit without its fold predicts it, weighted, shape (n,).
    folds
        The rows of each fold.
    alone
        For each fold, how many combinations of the model's columns its rows alone determine.
    """

    residual: F64
    folds: Sequence[Index]
    alone: tuple[int, ...]

    @classmethod
    def of(cls, basis: Basis, rows: Sequence[Index]) -> LeftOut:
        """Leave each fold out."""
        out = basis.residual.copy()
        alone = []
        for fold, left_out in zip(rows, basis.left_out(rows), strict=True):
            found = left_out.foretold(basis.extra[fold], basis.residual[fold])
            out[fold] = found[0]
            alone.append(found[1])
        return cls(out, rows, tuple(alone))

    @property
    def chi2(self) -> float:
        """Σ of squares."""
        return float(self.residual @ self.residual)

    def with_what_it_foretells(self, fuller: LeftOut) -> F64:
        """The residuals (n,) of a fuller model, but for folds of which it foretells nothing more.

        Where a cause's coefficients are determined by the left-out rows alone, the rest of the
        campaign knows nothing of it.
        """
        out = fuller.residual.copy()
        for fold, before, after in zip(self.folds, self.alone, fuller.alone, strict=True):
            if after > before:
                out[fold] = self.residual[fold]
        return out


def lonely(before: LeftOut, after: LeftOut) -> list[int]:
    """The folds that alone determine what a fuller model says more."""
    return [i for i, (a, b) in enumerate(zip(before.alone, after.alone, strict=True)) if b > a]


def gain(before: LeftOut, after: LeftOut, *, bound: bool = False) -> float:
    """Part of the left-out residual variance that a cause removes.

    0.3 means that unseen blocks are predicted with 30 % less variance; negative: worse.

    Parameters
    ----------
    before, after
        What the model leaves without the cause and with it.
    bound
        Whether the cause belongs to the placing of an instrument, and so may be fitted to the very
        rows that show it.
    """
    left = after.residual if bound else before.with_what_it_foretells(after)
    return 1.0 - float(left @ left) / before.chi2 if before.chi2 > 0.0 else 0.0
