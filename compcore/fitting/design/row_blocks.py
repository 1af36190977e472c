"""Row blocks of a design matrix too large to be formed as a whole, each of whole set-ups."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.nuisance import Eliminator

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK_BYTES = 16_000_000
"""A larger design matrix is never formed as a whole, but in blocks of about this size."""
FEWEST_ROWS = 1000
"""Smaller blocks would cost more than they save."""


@dataclass(frozen=True, eq=False)
class RowBlock:
    """A block of rows, whole set-ups mostly, whose design matrix is formed at once.

    Attributes
    ----------
    rows
        Indices, whole set-ups one after another, or a part of one set-up.
    bases
        Orthonormal nuisance bases: (positions within `rows`, basis (m, k)).
    split
        Whether `rows` are only a part of their set-up; its last block has `last`.
    """

    rows: Index
    bases: tuple[tuple[Index, F64], ...]
    split: bool = False
    last: bool = True


def rows_at_once(columns: int) -> int:
    """The number of rows for which a matrix with so many columns is formed at once."""
    return max(FEWEST_ROWS, BLOCK_BYTES // (8 * max(columns, 1)))


def row_blocks(eliminator: Eliminator, columns: int) -> Iterator[RowBlock]:
    """The rows of all set-ups, as many at once as `rows_at_once` allows for the columns."""
    most = rows_at_once(columns)
    gathered: list[tuple[Index, F64]] = []
    count = 0
    for rows, basis in eliminator.all_bases():
        if gathered and count + len(rows) > most:
            yield _joined(gathered)
            gathered, count = [], 0
        if len(rows) > most:
            cuts = list(range(0, len(rows), most))
            for at in cuts:
                part = slice(at, at + most)
                own = (np.arange(len(rows[part])), basis[part])
                yield RowBlock(rows[part], (own,), split=True, last=at == cuts[-1])
        else:
            gathered.append((rows, basis))
            count += len(rows)
    if gathered:
        yield _joined(gathered)


def _joined(gathered: list[tuple[Index, F64]]) -> RowBlock:
    bases = []
    at = 0
    for rows, basis in gathered:
        if basis.shape[1]:
            bases.append((np.arange(at, at + len(rows)), basis))
        at += len(rows)
    return RowBlock(np.concatenate([rows for rows, _ in gathered]), tuple(bases))
