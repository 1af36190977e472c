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

_LEAST_COLUMNS = 40
"""Columns laid out at once however long they are: the model is read through once for all of them,
and of a large campaign it is far longer than any cache."""

_ROUNDING = 1e-14
"""Squares below this part of a unit are rounding."""


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

    @cached_property
    def imitable(self) -> F64:
        """A matrix N, (n, m), by which a column c is shortened: by ``‖Nᵀc‖²``, squared.

        An orthonormal basis of the model's columns and of the set-ups' nuisances; where gauges'
        errors are whitened their part besides. `extra` is left apart.
        """
        if self.eliminator.whitening is not None:
            return np.hstack(
                [self.eliminator.project(self.q), self._nuisances, self.eliminator.common_basis()]
            )
        return np.hstack([self.q, self._nuisances])

    @property
    def _nuisances(self) -> F64:
        """Orthonormal basis of the set-ups' nuisances, (n, rank)."""
        out = np.zeros((len(self.q), self.eliminator.rank))
        at = 0
        for rows, own in self.eliminator.bases():
            out[rows, at : at + own.shape[1]] = own
            at += own.shape[1]
        return out

    @cached_property
    def moments(self) -> F64:
        """Residual and `extra` side by side, (n, 1 + m), for inner products with bare columns.

        Bare: neither projected nor whitened.
        """
        stacked = np.column_stack([self.residual, self.extra])
        return stacked if self.eliminator.whitening is None else self.eliminator.project(stacked)

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


@dataclass(frozen=True, eq=False)
class Frame:
    """Orthonormal directions of the rows' space, in which some candidates' columns lie.

    Attributes
    ----------
    rows
        The rows in which the directions are not zero, shape (v,), or all.
    model
        What the fitted model can imitate there: ``N Nᵀ`` is the projection on it in the directions'
        coordinates, shape (directions, r).
    number, unit
        For directions that are sums of rows: each row's direction, ascending, and its part in it,
        shape (v,) each. None where each row is a direction of its own.
    count
        Number of directions.
    setups
        What each set-up's nuisances can imitate besides `model`, as it is zero outside their own
        rows: the rows, and an orthonormal basis there, (rows, k).
    """

    rows: NDArray[np.int64] | slice
    model: F64
    count: int
    number: NDArray[np.int64] | None = None
    unit: F64 | None = None
    setups: Sequence[tuple[NDArray[np.int64] | slice, F64]] = ()

    @classmethod
    def whole(cls, fitted: Basis) -> Frame:
        """All rows."""
        n = len(fitted.residual)
        if fitted.eliminator.whitening is not None:
            return cls(slice(None), fitted.imitable, n)
        own = tuple((_span(rows), basis) for rows, basis in fitted.eliminator.bases())
        return cls(slice(None), fitted.q, n, setups=own)

    @classmethod
    def of_rows(cls, fitted: Basis, rows: NDArray[np.int64]) -> Frame:
        """Some of the rows, (v,), ascending."""
        if len(rows) == len(fitted.residual):
            return cls.whole(fitted)
        return cls(_span(rows) if len(rows) else rows, _shorter(fitted.imitable[rows]), len(rows))

    @classmethod
    def of_places(
        cls,
        fitted: Basis,
        rows: NDArray[np.int64],
        number: NDArray[np.int64],
        unit: F64,
        count: int,
    ) -> Frame:
        """Sums of rows; see the attributes."""
        plain = cls(rows, np.zeros((count, 0)), count, number, unit)
        return replace(plain, model=_shorter(plain.of(fitted.imitable)))

    def imitated(self, columns: F64) -> F64:
        """What the fitted model takes of columns that are laid out as rows, (k, directions)."""
        parts = [columns @ self.model]
        parts += [columns[:, rows] @ basis for rows, basis in self.setups]
        return np.hstack(parts) if self.setups else parts[0]

    def of(self, vectors: F64) -> F64:
        """Coordinates of vectors of all rows, (n, k) → (directions, k)."""
        part = vectors[self.rows]
        if self.number is None or self.unit is None:
            return part
        out = np.zeros((self.count, part.shape[1]))
        if len(part):
            starts = np.flatnonzero(np.diff(self.number, prepend=-1))
            out[self.number[starts]] = np.add.reduceat(self.unit[:, None] * part, starts, axis=0)
        return out


@dataclass(frozen=True, eq=False)
class Placed:
    """Columns as coordinates in a frame, (directions, k)."""

    frame: Frame
    values: F64


def _shorter(model: F64) -> F64:
    """A matrix of no more columns than rows with the same ``N Nᵀ``."""
    if model.shape[0] < model.shape[1]:
        values, vectors = np.linalg.eigh(model @ model.T)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
    values, vectors = np.linalg.eigh(model.T @ model)
    return np.asarray(model @ vectors[:, values > _ROUNDING])


Trial = tuple[int, Mapping[str, float], Callable[[], "F64 | Placed"]]
"""Key, non-linear parameters, and a function that gives the weighted columns: (n, k), or what a
frame holds of them."""


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
        open_: dict[int, _Open] = {}
        whole: Frame | None = None
        for key, nonlinear, make in self._trials():
            made = make()
            if not isinstance(made, Placed):
                whole = Frame.whole(self._fitted) if whole is None else whole
                made = Placed(whole, made)
            mine = open_.setdefault(id(made.frame), _Open(made.frame))
            mine.trials.append((key, nonlinear))
            mine.columns.append(made.values)
            mine.size += made.values.size
            if mine.size > max(_BATCH, _LEAST_COLUMNS * mine.frame.count):
                yield _Batch.of(mine.frame, mine.trials, mine.columns)
                del open_[id(made.frame)]
        for mine in open_.values():
            yield _Batch.of(mine.frame, mine.trials, mine.columns)

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


@dataclass(eq=False)
class _Open:
    """Trials of one frame that wait for more."""

    frame: Frame
    trials: list[tuple[int, Mapping[str, float]]] = field(default_factory=list)
    columns: list[F64] = field(default_factory=list)
    size: int = 0


@dataclass(frozen=True, eq=False)
class _Batch:
    """Some trials' columns in one frame, scaled to length 1, and what the fitted model leaves.

    The columns themselves are never projected: with N an orthonormal basis of all that the fitted
    model can imitate, ``C⊥ᵀC⊥ = CᵀC − (NᵀC)ᵀ(NᵀC)``, and ``C⊥ᵀv = Cᵀv`` for every v that is
    orthogonal to N, as residuals and columns that joined later are (whitened once more where
    gauges' errors are whitened, `Basis.moments`). That is half the work, and exact enough: parts
    below `SEEN` are not reported anyway, 1e-6 of a square that is known to 1e-15.

    Attributes
    ----------
    frame
        Where the columns lie.
    trials
        What each is, those of one width together.
    columns
        One row for each column, shape (columns, directions of the frame).
    groups
        For each width: first trial, number of trials, first column, and the Gram matrices of
        what the fitted model leaves of the columns, (trials, width, width).
    """

    frame: Frame
    trials: Sequence[tuple[int, Mapping[str, float]]]
    columns: F64
    groups: Sequence[tuple[int, int, int, F64]]

    @classmethod
    def of(
        cls, frame: Frame, trials: Sequence[tuple[int, Mapping[str, float]]], columns: list[F64]
    ) -> _Batch:
        order = sorted(range(len(columns)), key=lambda i: columns[i].shape[1])
        stacked = np.ascontiguousarray(np.concatenate([columns[i].T for i in order]))
        norms = np.sqrt(np.einsum("ij,ij->i", stacked, stacked))
        stacked /= np.where(norms > 0.0, norms, 1.0)[:, None]
        imitated = frame.imitated(stacked)
        groups: list[tuple[int, int, int, F64]] = []
        widths = [columns[i].shape[1] for i in order]
        first = at = 0
        while first < len(order):
            width, count = widths[first], widths.count(widths[first])
            part = slice(at, at + count * width)
            gram = grams(stacked[part], width) - grams(imitated[part], width)
            groups.append((first, count, at, gram))
            first, at = first + count, at + count * width
        return cls(frame, [trials[i] for i in order], stacked, groups)

    def drops(self, basis: Basis) -> tuple[F64, NDArray[np.int64]]:
        """Fall of χ² and rank of every trial against a basis, each of shape (trials,)."""
        inner = self.columns @ self.frame.of(basis.moments)
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
