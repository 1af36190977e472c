"""Patterns beside a fitted model, tested again and again, and never all held in memory.

A pattern acts on one error motion, and most rows do not see it: a line along X is blind to errors
in Y. What depends on one recorded quantity alone has one value at each of its values. So columns
are made batch by batch on the rows, or the places, that tell them (`Frames`); what the fitted model
leaves of them (their Gram matrices) is computed once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.frames import Frames, Places
from abbe.compcore.diagnosis.screening.projection.bank import ScreenedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.projection.falls import drops_of, grams
from abbe.compcore.diagnosis.screening.projection.frame import Frame
from abbe.compcore.diagnosis.uncatalogued.patterns.oscillations import oscillating
from abbe.compcore.diagnosis.uncatalogued.patterns.pattern import CandidatePattern, PatternGroup
from abbe.compcore.machine.error_motion import ErrorMotion

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_BATCH = 400_000
"""Elements of columns made at once: as much as a processor's cache holds."""


_HELD = 4_000_000
"""Elements of columns that are kept (32 MB)."""


class PatternFamily:
    """Groups of forms, each on every one of some error motions, tested against what a model leaves.

    A pattern's key counts forms, and error motions within a form.

    Parameters
    ----------
    groups
        The forms.
    on
        The error motions.
    frames
        What each error motion's rows see.
    """

    def __init__(
        self, groups: Sequence[PatternGroup], on: Sequence[ErrorMotion], frames: Frames
    ) -> None:
        self._groups, self._on, self._frames = list(groups), tuple(on), frames
        self._starts = np.cumsum([0, *(g.count * len(on) for g in groups)])
        self._parts: dict[int, list[_FrameShare]] = {}
        self._batches = [
            batch for number, group in enumerate(groups) for batch in self._cut(number, group)
        ]
        self._left: dict[int, list[tuple[F64, F64]]] = {}
        self._held: dict[int, F64] = {}
        self._room = _HELD

    def __len__(self) -> int:
        return int(self._starts[-1])

    def pattern(self, key: int) -> CandidatePattern:
        """One of the patterns, put in words."""
        number = int(np.searchsorted(self._starts, key, side="right")) - 1
        form, motion = divmod(key - int(self._starts[number]), len(self._on))
        return self._groups[number].form(form).on(self._on[motion])

    def leading(self, basis: Basis, most: int) -> list[CandidatePattern]:
        """The patterns for which the data speak most, their coefficients priced."""
        keys, drop, rank = self._falls(basis)
        seen = rank > 0
        keys, drop, rank = keys[seen], drop[seen], rank[seen]
        if basis.chi2 > 0.0:
            left = np.maximum(basis.chi2 - drop, 1e-12 * basis.chi2)
            fall = basis.share * basis.dof * np.log(basis.chi2 / left)
            value = fall - rank * math.log(basis.independent)
            keys = keys[np.argsort(-value, kind="stable")]
        return [self.pattern(int(key)) for key in keys[:most]]

    def _cut(self, number: int, group: PatternGroup) -> Iterator[_FormBatch]:
        """A group in batches that a cache holds; none where no row sees any of it."""
        places = None if group.of is None else Places.of([group.of.value])
        if places is not None and not places.few:
            places = None
        parts = []
        for j, error_motion in enumerate(self._on):
            if places is None:
                frame, length = self._frames.seen(error_motion)
            else:
                frame, length = self._frames.at(error_motion, places)
            if length.any():
                parts.append(
                    _FrameShare(j, frame, length, None if places is None else places.first)
                )
        self._parts[number] = parts
        if not parts:
            return
        n = parts[0].domain(len(self._frames.weight))
        step = max(1, _BATCH // (group.width * max(1, n)))
        for at in range(0, group.count, step):
            yield _FormBatch(number, (at, min(at + step, group.count)))

    def _falls(self, basis: Basis) -> tuple[Index, F64, Index]:
        """Of the patterns, by key: the key, the fall of χ² and the number of columns seen."""
        vectors = basis.moments
        count = vectors.shape[1]
        targets = {
            number: np.hstack([part.target(vectors) for part in parts])
            for number, parts in self._parts.items()
            if parts
        }
        keys: list[Index] = [np.zeros(0, dtype=np.int64)]
        drops: list[F64] = [np.zeros(0)]
        ranks: list[Index] = [np.zeros(0, dtype=np.int64)]
        for number, batch in enumerate(self._batches):
            parts, width = self._parts[batch.group], self._groups[batch.group].width
            values = self._values(number, batch)
            if number not in self._left:
                self._left[number] = [part.left(values, width) for part in parts]
            inner = values @ targets[batch.group]
            forms = np.arange(*batch.forms) * len(self._on) + self._starts[batch.group]
            for i, (part, (size, left)) in enumerate(zip(parts, self._left[number], strict=True)):
                own = inner[:, i * count : (i + 1) * count] / size[:, None]
                drop, rank = drops_of(left, own[:, 0], np.ascontiguousarray(own[:, 1:]))
                keys.append(forms + part.motion)
                drops.append(drop)
                ranks.append(rank)
        key = np.concatenate(keys)
        order = np.argsort(key)
        return key[order], np.concatenate(drops)[order], np.concatenate(ranks)[order]

    def _values(self, number: int, batch: _FormBatch) -> F64:
        """A batch's basis functions, kept where there is room; oscillations are made as fast."""
        values = self._held.get(number)
        if values is None:
            group = self._groups[batch.group]
            first = self._parts[batch.group][0].first
            values = group.values(batch.forms, slice(None) if first is None else first)
            if values.size <= self._room and (group.of is None or first is not None):
                self._held[number] = values
                self._room -= values.size
        return values


@dataclass(frozen=True, eq=False)
class _FormBatch:
    """Some of a group's forms: number of the group, first form and last + 1."""

    group: int
    forms: tuple[int, int]


@dataclass(frozen=True, eq=False)
class _FrameShare:
    """What one error motion's rows, or places, see of a group's forms.

    Attributes
    ----------
    motion
        Number of the error motion.
    frame, length
        Where columns lie, and what a unit of the basis function is there.
    first
        Rows on which basis functions are made, one of each place; None: on all rows.
    """

    motion: int
    frame: Frame
    length: F64
    first: Index | None

    def domain(self, n: int) -> int:
        """Number of rows on which basis functions are made, of n in all."""
        return n if self.first is None else len(self.first)

    def target(self, vectors: F64) -> F64:
        """What basis functions are multiplied with for inner products with vectors, (n, k)."""
        own = self.length[:, None] * self.frame.of(vectors)
        if self.first is not None:
            return own
        out = np.zeros_like(vectors)
        out[self.frame.rows] = own
        return out

    def left(self, values: F64, width: int) -> tuple[F64, F64]:
        """Lengths of columns, and Gram matrices of what the fitted model leaves of them."""
        own = values if self.first is not None else values[:, self.frame.rows]
        return _left(own * self.length, self.frame, width)


def _left(columns: F64, frame: Frame, width: int) -> tuple[F64, F64]:
    """Columns' lengths, and Gram matrices of what the fitted model leaves of them at length 1."""
    square = np.einsum("ij,ij->i", columns, columns)
    size = np.sqrt(np.where(square > 0.0, square, 1.0))
    imitated = frame.imitated(columns) / size[:, None]
    own = grams(columns, width)
    scale = size.reshape(-1, width)
    own /= scale[:, :, None] * scale[:, None, :]
    return size, own - grams(imitated, width)


class PatternBank:
    """A few patterns, to be tested against what a model leaves.

    Parameters
    ----------
    patterns
        The patterns; a pattern's index is its key.
    frames
        What each error motion's rows see.
    """

    def __init__(self, patterns: Sequence[CandidatePattern], frames: Frames) -> None:
        self._patterns, self._frames = patterns, frames
        # an error motion that no row sees has no columns
        self._batches = [
            batch
            for (error_motion, width, _), keys in _alike(patterns).items()
            if frames.seen(error_motion)[1].size
            for batch in _batches(frames, error_motion, width, keys)
        ]
        self._kept: dict[int, tuple[F64, F64, F64]] = {}

    def screen(self, basis: Basis) -> list[ScreenedCandidate]:
        """Test all patterns against the fitted model, perhaps extended; those that are seen."""
        vectors = basis.moments
        found: dict[int, ScreenedCandidate] = {}
        for number, batch in enumerate(self._batches):
            frame, _ = self._frames.seen(batch.error_motion)
            if number not in self._kept:
                columns = self._columns(batch)
                self._kept[number] = (columns, *_left(columns, frame, batch.width))
            columns, size, left = self._kept[number]
            inner = (columns @ frame.of(vectors)) / size[:, None]
            drop, rank = drops_of(left, inner[:, 0], np.ascontiguousarray(inner[:, 1:]))
            for key, d, r in zip(batch.keys, drop.tolist(), rank.tolist(), strict=True):
                if r:
                    found[key] = ScreenedCandidate(key, {}, d, r)
        return [found[key] for key in sorted(found)]

    def _columns(self, batch: _Alike) -> F64:
        """Weighted columns as rows, (patterns · width, rows that see them)."""
        mine = [self._patterns[key] for key in batch.keys]
        frame, part = self._frames.seen(batch.error_motion)
        out = oscillating(mine, frame.rows)
        if out is None:
            out = np.concatenate([p.values(frame.rows).T for p in mine])
        return np.asarray(out * part)


@dataclass(frozen=True, eq=False)
class _Alike:
    """Patterns of one width on one error motion."""

    error_motion: ErrorMotion
    keys: tuple[int, ...]
    width: int


_Kind = tuple[ErrorMotion, int, object]


def _alike(patterns: Sequence[CandidatePattern]) -> dict[_Kind, list[int]]:
    """Error motion, width, and what oscillations have in common → the patterns' keys."""
    found: dict[_Kind, list[int]] = {}
    for key, pattern in enumerate(patterns):
        wave = pattern.wave
        kind = None if wave is None else (wave.v, wave.along, wave.harmonics)
        found.setdefault((pattern.error_motion, pattern.width, kind), []).append(key)
    return found


def _batches(
    frames: Frames, error_motion: ErrorMotion, width: int, keys: Sequence[int]
) -> Iterator[_Alike]:
    rows = max(1, frames.seen(error_motion)[0].count)
    step = max(1, _BATCH // (width * rows))
    for at in range(0, len(keys), step):
        yield _Alike(error_motion, tuple(keys[at : at + step]), width)
