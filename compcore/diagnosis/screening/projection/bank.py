"""Screening: every candidate's exact effect on χ², without refitting once.

Added-variable projection. With J the current model's weighted Jacobian, nuisances included, Q an
orthonormal basis of its columns, r the weighted residual and C a candidate's weighted columns:
``C⊥ = C − Q(QᵀC)``; refitting everything together with the candidate would lower χ² by exactly
``‖P_{C⊥} r‖²`` (Frisch–Waugh–Lovell).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.projection.falls import drops_of, grams
from abbe.compcore.diagnosis.screening.projection.frame import Frame, Placed

F64 = NDArray[np.float64]

_BATCH = 400_000
"""Elements of candidate columns laid out at once: as much as a processor's cache holds."""

_LEAST_COLUMNS = 40
"""Columns laid out at once however long they are: the model is read through once for all of them,
and of a large campaign it is far longer than any cache."""


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


def drop_of(basis: Basis, whole: Frame, made: F64 | Placed) -> float:
    """Fall of χ² by one candidate's columns; `whole`: the frame of all rows (`Frame.whole`)."""
    placed = made if isinstance(made, Placed) else Placed(whole, made)
    drop, _ = _Batch.of(placed.frame, [(0, {})], [placed.values]).drops(basis)
    return float(drop[0])


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
