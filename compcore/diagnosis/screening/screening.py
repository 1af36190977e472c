"""Screening: every candidate's exact effect on χ², without refitting once.

Added-variable projection. With J the current model's weighted Jacobian, nuisances included, Q an
orthonormal basis of its columns, r the weighted residual and C a candidate's weighted columns:
``C⊥ = C − Q(QᵀC)``; refitting everything together with the candidate would lower χ² by exactly
``‖P_{C⊥} r‖²`` (Frisch–Waugh–Lovell).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.nuisance import Eliminator
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.linalg import svd

F64 = NDArray[np.float64]

SEEN = 1e-3
"""Least part of a candidate's column (norm) outside the model's span for it to be seen at all."""

_BATCH = 400_000
"""Elements of candidate columns laid out at once: as much as a processor's cache holds."""


@dataclass(frozen=True, eq=False)
class Basis:
    """What the current model explains, and what it leaves.

    Attributes
    ----------
    q
        Orthonormal basis of the weighted Jacobian's columns, set-ups' nuisances projected out,
        shape (n, rank).
    residual
        Weighted residual, shape (n,), orthogonal to q, to `extra` and to the nuisances.
    eliminator
        What projects the set-ups' nuisances out.
    extra
        Orthonormal columns that joined the model since the fit, shape (n, m).
    observations
        Number of observations where rows are not the observations themselves, but a triangular
        factor of theirs; None where they are.
    share
        Part of the observations that count as independent (`independence`): neighbours in time
        whose residuals are alike say nothing new.
    """

    q: F64
    residual: F64
    eliminator: Eliminator
    extra: F64
    observations: int | None = None
    share: float = 1.0

    @classmethod
    def of(cls, result: FitResult) -> Basis:
        """The basis at the solution of a fit."""
        none = np.zeros((result.weighted.shape[0], 0))
        return cls(result.basis, result.weighted, result.eliminator, none)

    @property
    def n(self) -> int:
        """Number of observations."""
        return len(self.residual) if self.observations is None else self.observations

    @property
    def independent(self) -> float:
        """Number of observations that count as independent."""
        return max(2.0, self.share * self.n)

    @cached_property
    def dof(self) -> int:
        """Degrees of freedom left."""
        return self.n - int(self.q.shape[1] + self.extra.shape[1]) - self.eliminator.rank

    @cached_property
    def chi2(self) -> float:
        """Weighted sum of squares left."""
        return float(self.residual @ self.residual)

    def project_fitted(self, columns: F64) -> F64:
        """The part of columns (n, k) that the fitted model cannot imitate, `extra` apart."""
        left = self.eliminator.project(columns)
        left -= self.q @ (self.q.T @ left)
        return left

    def project(self, columns: F64) -> F64:
        """The part of columns (n, k) that neither the model nor `extra` can imitate."""
        left = self.project_fitted(columns)
        if self.extra.shape[1]:
            left -= self.extra @ (self.extra.T @ left)
        return left

    def imitated(self, rows: F64) -> F64:
        """What the fitted model takes of columns that are laid out as rows, (k, n): rows · N.

        N, (n, rank), is an orthonormal basis of the model's columns and the nuisances; `extra` is
        left apart.
        """
        parts = [rows @ self.q]
        parts += [rows[:, _span(own)] @ basis for own, basis in self.eliminator.bases()]
        return np.hstack(parts)

    def with_residual(self, residual: F64) -> Basis:
        """The same model beside other residuals, (n,), weighted and projected: a signature."""
        return replace(self, residual=residual)

    def extended(self, columns: F64) -> Basis:
        """The basis after columns (n, k) were added to the model."""
        new = orthonormal(self.project(columns), np.linalg.norm(columns, axis=0))
        if not new.shape[1]:
            return self
        residual = self.residual - new @ (new.T @ self.residual)
        return replace(self, residual=residual, extra=np.hstack([self.extra, new]))


def _span(rows: NDArray[np.int64]) -> NDArray[np.int64] | slice:
    """Rows as a slice where they follow one another: a view instead of a copy."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first == len(rows) - 1 else rows


def orthonormal(projected: F64, original: F64) -> F64:
    """Orthonormal basis of projected columns (n, k) that are seen, shape (n, rank).

    `original` holds the columns' norms before the projection, shape (k,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(original > 0.0, projected / np.where(original > 0, original, 1.0), 0.0)
    u, s, _ = svd(scaled)
    return np.asarray(u[:, s > SEEN])


@dataclass(frozen=True, eq=False)
class ScreenedCandidate:
    """One candidate at one choice of its non-linear parameters.

    Attributes
    ----------
    key
        What the caller knows the candidate by.
    nonlinear
        Non-linear parameters at which the columns were taken.
    drop
        Fall of χ² if it were added.
    rank
        Number of its columns that the campaign determines; 0: it is in the model's span.
    tried
        Number of choices of non-linear parameters that were tried to find this one.
    """

    key: int
    nonlinear: Mapping[str, float] = field(default_factory=dict)
    drop: float = 0.0
    rank: int = 0
    tried: int = 1


Trial = tuple[int, Mapping[str, float], Callable[[], F64]]
"""Key, non-linear parameters, and a function that gives the weighted columns (n, k)."""


class Bank:
    """Candidates' columns, laid beside a fitted model once, to be tested again and again.

    What joined the model since (`Basis.extra`) costs a few inner products. Where the columns do not
    fit into memory they are made again for every test.

    Parameters
    ----------
    fitted
        The basis of the fitted model.
    trials
        Makes the trials; called again where nothing is held.
    hold
        Greatest number of elements held.
    """

    def __init__(
        self, fitted: Basis, trials: Callable[[], Iterable[Trial]], hold: int = 60_000_000
    ) -> None:
        self._fitted = fitted
        self._trials = trials
        self._held: list[_Batch] | None = []
        size = 0
        for batch in self._batches():
            size += batch.columns.size
            if size > hold:
                self._held = None
                break
            self._held.append(batch)

    def _batches(self) -> Iterator[_Batch]:
        trials: list[tuple[int, Mapping[str, float]]] = []
        columns: list[F64] = []
        size = 0
        for key, nonlinear, make in self._trials():
            c = make()
            trials.append((key, nonlinear))
            columns.append(c)
            size += c.size
            if size > _BATCH:
                yield _Batch.of(self._fitted, trials, columns)
                trials, columns, size = [], [], 0
        if columns:
            yield _Batch.of(self._fitted, trials, columns)

    def screen(
        self, basis: Basis, without: frozenset[int] = frozenset()
    ) -> list[ScreenedCandidate]:
        """Test all candidates against what a basis leaves; of one key's choices the best is kept.

        Parameters
        ----------
        basis
            The fitted model, perhaps extended.
        without
            Keys to leave out.

        Returns
        -------
        One entry for each key, in ascending order.
        """
        trials: list[tuple[int, Mapping[str, float]]] = []
        drops: list[F64] = []
        ranks: list[NDArray[np.int64]] = []
        for batch in self._batches() if self._held is None else self._held:
            drop, rank = batch.drops(basis)
            trials += batch.trials
            drops.append(drop)
            ranks.append(rank)
        if not trials:
            return []
        drop, rank = np.concatenate(drops), np.concatenate(ranks)
        keys = np.array([key for key, _ in trials])
        # by key, of each the greatest fall first; of equal ones the first that was tried
        order = np.lexsort((-drop, keys))
        unique, first, tried = np.unique(keys[order], return_index=True, return_counts=True)
        return [
            ScreenedCandidate(key, trials[i][1], float(drop[i]), int(rank[i]), count)
            for key, i, count in zip(
                unique.tolist(), order[first].tolist(), tried.tolist(), strict=True
            )
            if key not in without
        ]


def screen(basis: Basis, trials: Iterable[Trial]) -> list[ScreenedCandidate]:
    """Test a few candidates once; see `Bank.screen`."""
    listed = list(trials)
    return Bank(basis, lambda: listed).screen(basis)


@dataclass(frozen=True, eq=False)
class _Batch:
    """Some trials' columns, scaled to length 1, and what the fitted model leaves of them.

    The columns themselves are never projected: with N an orthonormal basis of all that the fitted
    model can imitate, ``C⊥ᵀC⊥ = CᵀC − (NᵀC)ᵀ(NᵀC)``, and ``C⊥ᵀv = Cᵀv`` for every v that is
    orthogonal to N, as residuals and columns that joined later are. That is half the work, and
    exact enough: parts below `SEEN` are not told anyway, 1e-6 of a square that is known to 1e-15.

    Attributes
    ----------
    trials
        What each is, those of one width together.
    columns
        One row for each column, shape (columns, n).
    groups
        For each width: first trial, number of trials, first column, and the Gram matrices of
        what the fitted model leaves of the columns, (trials, width, width).
    """

    trials: Sequence[tuple[int, Mapping[str, float]]]
    columns: F64
    groups: Sequence[tuple[int, int, int, F64]]

    @classmethod
    def of(
        cls, fitted: Basis, trials: Sequence[tuple[int, Mapping[str, float]]], columns: list[F64]
    ) -> _Batch:
        order = sorted(range(len(columns)), key=lambda i: columns[i].shape[1])
        stacked = np.empty((sum(c.shape[1] for c in columns), len(fitted.residual)))
        at = 0
        for i in order:
            width = columns[i].shape[1]
            stacked[at : at + width] = columns[i].T
            at += width
        norms = np.sqrt(np.einsum("ij,ij->i", stacked, stacked))
        stacked /= np.where(norms > 0.0, norms, 1.0)[:, None]
        imitated = fitted.imitated(stacked)
        groups: list[tuple[int, int, int, F64]] = []
        widths = [columns[i].shape[1] for i in order]
        first = at = 0
        while first < len(order):
            width, count = widths[first], widths.count(widths[first])
            part = slice(at, at + count * width)
            gram = grams(stacked[part], width) - grams(imitated[part], width)
            groups.append((first, count, at, gram))
            first, at = first + count, at + count * width
        return cls([trials[i] for i in order], stacked, groups)

    def drops(self, basis: Basis) -> tuple[F64, NDArray[np.int64]]:
        """Fall of χ² and rank of every trial against a basis, each of shape (trials,)."""
        inner = self.columns @ np.column_stack([basis.residual, basis.extra])
        drop, rank = np.empty(len(self.trials)), np.empty(len(self.trials), dtype=np.int64)
        for first, count, at, fitted in self.groups:
            own = inner[at : at + count * fitted.shape[1]]
            trials = slice(first, first + count)
            drop[trials], rank[trials] = drops_of(
                fitted, own[:, 0], np.ascontiguousarray(own[:, 1:])
            )
        return drop, rank


def drops_of(left: F64, moment: F64, joined: F64) -> tuple[F64, NDArray[np.int64]]:
    """Fall of χ² and rank of trials of one width, each of shape (trials,).

    Parameters
    ----------
    left
        Gram matrices of what the fitted model leaves of their columns, (trials, width, width).
    moment
        Inner products of the columns with the residual, (trials · width,).
    joined
        And with the orthonormal columns that joined the model since, (trials · width, m).
    """
    width = left.shape[1]
    gram = left - grams(joined, width)
    b = moment.reshape(-1, width)
    if width == 1:
        square = gram[:, 0, 0]
        seen = square > SEEN**2
        drop = np.where(seen, b[:, 0] ** 2 / np.where(seen, square, 1.0), 0.0)
        return drop, seen.astype(np.int64)
    if width == 2:
        return _drops_of_pairs(gram, b)
    values, vectors = np.linalg.eigh(gram)
    visible = values > SEEN**2
    part = np.einsum("kij,ki->kj", vectors, b)
    drop = np.where(visible, part**2 / np.where(visible, values, 1.0), 0.0).sum(axis=1)
    return drop, visible.sum(axis=1)


def _drops_of_pairs(gram: F64, b: F64) -> tuple[F64, NDArray[np.int64]]:
    """As `drops_of` for two columns: thousands of eigenvalue problems in closed form."""
    p, q, r = gram[:, 0, 0], gram[:, 1, 1], gram[:, 0, 1]
    half, mean = 0.5 * (p - q), 0.5 * (p + q)
    root = np.hypot(half, r)
    # the eigenvector of the greater eigenvalue, the other at a right angle to it
    angle = 0.5 * np.arctan2(r, half)
    c, s = np.cos(angle), np.sin(angle)
    along = (c * b[:, 0] + s * b[:, 1], -s * b[:, 0] + c * b[:, 1])
    drop, rank = np.zeros(len(b)), np.zeros(len(b), dtype=np.int64)
    for value, part in zip((mean + root, mean - root), along, strict=True):
        visible = value > SEEN**2
        drop += np.where(visible, part**2 / np.where(visible, value, 1.0), 0.0)
        rank += visible
    return drop, rank


def grams(rows: F64, width: int) -> F64:
    """Gram matrix of each `width` rows that follow one another, (rows/width, width, width)."""
    if width == 1:
        return np.asarray(np.einsum("ij,ij->i", rows, rows))[:, None, None]
    blocks = rows.reshape(len(rows) // width, width, rows.shape[1])
    return np.asarray(blocks @ np.swapaxes(blocks, 1, 2))
