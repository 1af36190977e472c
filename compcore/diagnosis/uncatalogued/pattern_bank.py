"""A family of patterns beside a fitted model, tested again and again, and never held in memory.

A pattern acts on one error motion, and most rows do not see it: a line along X is blind to errors
in Y. So columns are made on the rows that see them only, batch by batch, anew for every test; what
the fitted model leaves of them (their Gram matrices) is computed once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.screening import Basis, ScreenedCandidate, drops_of, grams
from abbe.compcore.diagnosis.uncatalogued.patterns import CandidatePattern, oscillating
from abbe.compcore.machine.error_motion import ErrorMotion

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_BATCH = 400_000
"""Elements of columns made at once: as much as a processor's cache holds."""


_HELD = 4_000_000
"""Elements of columns that are kept (32 MB)."""


class VisibleParts:
    """For each error motion the rows that see it; worked out once for all banks.

    Parameters
    ----------
    fitted
        The basis of the fitted model.
    seen
        Error motion → its weighted part in each row, shape (n,).
    """

    def __init__(self, fitted: Basis, seen: Mapping[ErrorMotion, F64]) -> None:
        self._fitted = fitted
        self.seen = seen
        self._parts: dict[ErrorMotion, _Part] = {}

    def of(self, error_motions: Iterable[ErrorMotion]) -> list[_Part]:
        """The parts of those error motions that some row sees."""
        found = []
        for c in error_motions:
            if c not in self._parts and self.seen[c].any():
                self._parts[c] = _Part.of(self._fitted, c, self.seen[c])
            found += [self._parts[c]] if c in self._parts else []
        return found


class PatternBank:
    """Patterns, to be tested against what a model leaves.

    Parameters
    ----------
    patterns
        The family; a pattern's index is its key.
    visible
        What each error motion's rows see.
    """

    def __init__(self, patterns: Sequence[CandidatePattern], visible: VisibleParts) -> None:
        self._patterns = patterns
        # an error motion that no row sees has no columns, and no part
        self._parts = visible.of({p.error_motion: None for p in patterns})
        alike = _alike(patterns)
        self._batches = [batch for part in self._parts for batch in _batches(part, alike)]
        self._grams: dict[int, tuple[F64, F64]] = {}
        self._held: dict[int, F64] = {}
        self._room = _HELD

    def screen(self, basis: Basis) -> list[ScreenedCandidate]:
        """Test all patterns against the fitted model, perhaps extended; those that are seen."""
        keys, drop, rank = self._falls(basis)
        told = zip(keys.tolist(), drop.tolist(), rank.tolist(), strict=True)
        return [ScreenedCandidate(key, {}, d, r) for key, d, r in told if r]

    def leading(self, basis: Basis, most: int) -> list[int]:
        """Keys of the patterns for which the data speak most, their coefficients priced."""
        keys, drop, rank = self._falls(basis)
        seen = rank > 0
        keys, drop, rank = keys[seen], drop[seen], rank[seen]
        if basis.chi2 > 0.0:
            left = np.maximum(basis.chi2 - drop, 1e-12 * basis.chi2)
            fall = basis.share * basis.dof * np.log(basis.chi2 / left)
            value = fall - rank * math.log(basis.independent)
            keys = keys[np.argsort(-value, kind="stable")]
        return [int(key) for key in keys[:most]]

    def _falls(self, basis: Basis) -> tuple[Index, F64, Index]:
        """Of the patterns, by key: the key, the fall of χ² and the number of columns seen."""
        targets = {
            part.error_motion: np.column_stack([basis.residual, basis.extra])[part.rows]
            for part in self._parts
        }
        keys: list[int] = []
        drops: list[F64] = [np.zeros(0)]
        ranks: list[Index] = [np.zeros(0, dtype=np.int64)]
        for number, batch in enumerate(self._batches):
            columns = self._columns(number, batch)
            if number not in self._grams:
                square = np.einsum("ij,ij->i", columns, columns)
                size = np.sqrt(np.where(square > 0.0, square, 1.0))
                imitated = batch.part.imitated(columns) / size[:, None]
                own = grams(columns, batch.width)
                scale = size.reshape(-1, batch.width)
                own /= scale[:, :, None] * scale[:, None, :]
                self._grams[number] = (size, own - grams(imitated, batch.width))
            size, left = self._grams[number]
            inner = (columns @ targets[batch.part.error_motion]) / size[:, None]
            drop, rank = drops_of(left, inner[:, 0], np.ascontiguousarray(inner[:, 1:]))
            keys += batch.keys
            drops.append(drop)
            ranks.append(rank)
        order = np.argsort(np.array(keys, dtype=np.int64))
        return (
            np.array(keys, dtype=np.int64)[order],
            np.concatenate(drops)[order],
            np.concatenate(ranks)[order],
        )

    def _columns(self, number: int, batch: _Batch) -> F64:
        """A batch's columns, kept where there is room; oscillations are made again as fast."""
        columns = self._held.get(number)
        if columns is None:
            columns = batch.columns(self._patterns)
            if columns.size <= self._room and self._patterns[batch.keys[0]].wave is None:
                self._held[number] = columns
                self._room -= columns.size
        return columns


@dataclass(frozen=True, eq=False)
class _Part:
    """The rows that see an error motion, and what the fitted model can imitate there."""

    error_motion: ErrorMotion
    rows: Index
    seen: F64
    q: F64
    nuisances: tuple[tuple[Index | slice, F64], ...]

    @classmethod
    def of(cls, fitted: Basis, error_motion: ErrorMotion, seen: F64) -> _Part:
        rows = np.flatnonzero(seen)
        at = np.full(len(seen), -1)
        at[rows] = np.arange(len(rows))
        nuisances: list[tuple[Index | slice, F64]] = []
        for own, basis in fitted.eliminator.bases():
            places = at[own]
            mine = places >= 0
            if mine.any():
                nuisances.append((_span(places[mine]), basis[mine]))
        return cls(error_motion, rows, seen[rows], fitted.q[rows], tuple(nuisances))

    def imitated(self, columns: F64) -> F64:
        """What the fitted model takes of columns that are laid out as rows, (k, rows)."""
        parts = [columns @ self.q]
        parts += [columns[:, places] @ basis for places, basis in self.nuisances]
        return np.hstack(parts)


def _span(rows: Index) -> Index | slice:
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first == len(rows) - 1 else rows


@dataclass(frozen=True, eq=False)
class _Batch:
    """Patterns of one width on one error motion."""

    part: _Part
    keys: tuple[int, ...]
    width: int

    def columns(self, patterns: Sequence[CandidatePattern]) -> F64:
        """Weighted columns as rows, (patterns · width, rows that see them)."""
        mine = [patterns[key] for key in self.keys]
        out = oscillating(mine, self.part.rows)
        if out is None:
            out = np.concatenate([p.values(self.part.rows).T for p in mine])
        out *= self.part.seen
        return out


_Kind = tuple[ErrorMotion, int, object]


def _alike(patterns: Sequence[CandidatePattern]) -> dict[_Kind, list[int]]:
    """Error motion, width, and what oscillations have in common → the patterns' keys."""
    found: dict[_Kind, list[int]] = {}
    for key, pattern in enumerate(patterns):
        wave = pattern.wave
        kind = None if wave is None else (wave.v, wave.along, wave.harmonics)
        found.setdefault((pattern.error_motion, pattern.width, kind), []).append(key)
    return found


def _batches(part: _Part, alike: Mapping[_Kind, list[int]]) -> Iterator[_Batch]:
    for (error_motion, width, _), keys in alike.items():
        if error_motion == part.error_motion:
            step = max(1, _BATCH // (width * max(1, len(part.rows))))
            for at in range(0, len(keys), step):
                yield _Batch(part, tuple(keys[at : at + step]), width)
