"""The design matrix reduced to its triangular factor, in row blocks where it is large.

The triangular factor of a QR decomposition holds all that least squares needs, and factors of
row blocks combine to that of the whole: memory does not grow with the number of rows, and unlike
normal equations nothing is squared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.design.prepared_rows import OutsideEffect
from abbe.compcore.fitting.design.row_blocks import RowBlock
from abbe.compcore.fitting.determinacy import Decomposition

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_CACHED_ROWS = 1500
"""Rows that are factorised at once: as many as a processor's cache holds, three times as fast."""


def triangle(
    problem: Problem, theta: F64, free: Index | None = None, beside: Sequence[OutsideEffect] = ()
) -> F64:
    """The triangular factor of [∂/∂θ, more columns, residual], nuisances projected out.

    Shape (k, m + b + 1) with m the number of unknowns, or of those that are `free`, and b that of
    the columns of effects `beside` the model; the last column is the weighted residual at θ.
    """
    free = np.arange(problem.layout.size) if free is None else free

    def columns_of(part: Problem) -> F64:
        more = [part.effect_columns(o.effect, o.nonlinear, o.at(theta)) for o in beside]
        return np.column_stack([part.columns(theta)[:, free], *more, part.residual(theta)])

    if not problem.large:
        columns = problem.eliminator(theta).project(columns_of(problem))
        return _factor(np.vstack([columns, _prior(problem, theta, free, columns.shape[1])]))
    if beside:
        problem = problem.prepared_for(beside, theta)
    block_columns = _of_blocks(problem, theta, columns_of)
    factors: list[F64] = []
    shared = np.zeros((0, 0))
    for row_block in problem.row_blocks(theta):
        columns = block_columns(row_block)
        if row_block.split:
            # rows of one set-up, block after block: its nuisances stand in front and drop out at
            # the end, when all of them have been seen
            ((_, basis),) = row_block.bases
            k = basis.shape[1]
            block = np.hstack([basis, columns])
            shared = _factor(np.vstack([shared, block]) if shared.size else block)
            if row_block.last:
                factors = [_factor(np.vstack([*factors, shared[k:, k:]]))]
                shared = np.zeros((0, 0))
        else:
            for rows, basis in row_block.bases:
                own = columns[rows]
                columns[rows] = own - basis @ (basis.T @ own)
            factors = [_factor(np.vstack([*factors, columns]))]
    known = _prior(problem, theta, free, factors[0].shape[1])
    return _factor(np.vstack([*factors, known])) if len(known) else factors[0]


def _prior(problem: Problem, theta: F64, free: Index, width: int) -> F64:
    """What is known beforehand, as further rows of `triangle`: shape (known unknowns, width)."""
    sd = problem.prior_sd[free]
    known = np.flatnonzero(np.isfinite(sd))
    out = np.zeros((len(known), width))
    out[np.arange(len(known)), known] = 1.0 / sd[known]
    out[:, -1] = -theta[free][known] / sd[known]
    if problem.expected is None:
        return out
    more = np.zeros((len(problem.expected), width))
    more[:, : len(free)] = problem.expected[:, free]
    more[:, -1] = -problem.expected @ theta
    return np.vstack([out, more])


def leverage(
    problem: Problem, theta: F64, decomposition: Decomposition, free: Index | None = None
) -> F64:
    """The leverage of each row, 0 … 1, shape (n,): the diagonal of the hat matrix.

    `free` are the unknowns that were fitted, if not all; the decomposition is theirs.
    """
    d = decomposition
    mixing = np.zeros((problem.layout.size, d.rank))
    fitted = slice(None) if free is None else free
    mixing[fitted] = d.scale[:, None] * d.determined / d.singular[: d.rank]
    eliminator = problem.eliminator(theta)
    out = eliminator.leverage(problem.n)
    if not problem.large:
        hat = eliminator.project(problem.columns(theta)) @ mixing
        return np.asarray(out + np.einsum("ij,ij->i", hat, hat))
    mixed = _of_blocks(problem, theta, lambda part: np.asarray(part.columns(theta) @ mixing))
    for rows, hat in _projected(problem, theta, mixed):
        out[rows] += np.einsum("ij,ij->i", hat, hat)
    return out


_Columns = Callable[[RowBlock], F64]


def _of_blocks(problem: Problem, theta: F64, columns_of: Callable[[Problem], F64]) -> _Columns:
    """Columns of a block of rows, made anew each time; gauges' errors whitened.

    What whitening takes off in the gauges' directions is known after a first pass over all rows.
    """

    def bare(row_block: RowBlock) -> F64:
        return columns_of(problem.part(row_block.rows, theta))

    whitening = problem.eliminator(theta).whitening
    if whitening is None:
        return bare
    common = whitening.common
    seen = sum(common.sums(columns, rows) for rows, columns in _projected(problem, theta, bare))
    less = whitening.root @ seen

    def whitened(row_block: RowBlock) -> F64:
        return bare(row_block) - common.times(less, row_block.rows)

    return whitened


def _projected(problem: Problem, theta: F64, columns_of: _Columns) -> Iterator[tuple[Index, F64]]:
    """Rows and their columns, nuisances projected out, block by block."""
    for group in _setups_together(problem, theta):
        share: F64 | None = None
        if len(group) > 1:
            # what the nuisances of a split set-up take out is known after a first pass
            share = np.sum([p.bases[0][1].T @ columns_of(p) for p in group], axis=0)
        for row_block in group:
            columns = columns_of(row_block)
            for rows, basis in row_block.bases:
                own = columns[rows]
                columns[rows] = own - basis @ (basis.T @ own if share is None else share)
            yield row_block.rows, columns


def _setups_together(problem: Problem, theta: F64) -> Iterator[list[RowBlock]]:
    """Pieces, those of one split set-up in one list."""
    group: list[RowBlock] = []
    for row_block in problem.row_blocks(theta):
        group.append(row_block)
        if row_block.last:
            yield group
            group = []


def _factor(matrix: F64) -> F64:
    """The triangular factor R of a QR decomposition, shape (min(n, m), m)."""
    m = matrix.shape[1]
    step = max(_CACHED_ROWS, 4 * m)
    done = np.zeros((0, m))
    for at in range(0, max(matrix.shape[0], 1), step):
        block = np.vstack([done, matrix[at : at + step]])
        done = np.asarray(np.linalg.qr(block, mode="r"))
    return np.asarray(done)
