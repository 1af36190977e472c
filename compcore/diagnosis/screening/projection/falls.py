"""Falls of χ²: what columns would explain beside a model, from their inner products alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.projection.basis import SEEN

F64 = NDArray[np.float64]


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


def drops_together(cross: F64, one: F64, other: F64, seen: float) -> tuple[F64, NDArray[np.int64]]:
    """Fall of χ² and rank of two causes together, of many pairs, each of shape (pairs,).

    Both are orthonormal columns A and B, so with ``AᵀB = U σ Vᵀ`` the eigenvalues of what they span
    together are 1 ± σ and 1: each pair of directions is a problem of two numbers.

    Parameters
    ----------
    cross
        Inner products of the columns of one with those of the other, (pairs, a, b), b ≤ a.
    one, other
        Theirs with the residual, (pairs, a) and (pairs, b).
    seen
        Eigenvalues below this are not seen: both say the same there.
    """
    narrow = cross.shape[2]
    shared = np.einsum("pij,pi->pj", cross, one)
    if narrow == 1:
        square = np.einsum("pij,pij->pj", cross, cross)
        q, w = other, shared
    else:
        square, turns = np.linalg.eigh(np.swapaxes(cross, 1, 2) @ cross)
        q = np.einsum("pij,pi->pj", turns, other)
        w = np.einsum("pij,pi->pj", turns, shared)
    sigma = np.sqrt(np.maximum(square, 0.0))
    apart = sigma < 1.0 - seen
    p = np.where(apart, 0.0, w / np.where(apart, 1.0, sigma))
    both = (q - w) ** 2 / np.where(apart, 1.0 - square, 1.0)
    same = (p + q) ** 2 / (2.0 * (1.0 + sigma)) - p**2
    drop = np.einsum("pi,pi->p", one, one) + np.where(apart, both, same).sum(axis=1)
    return drop, cross.shape[1] + narrow - (~apart).sum(axis=1)


def grams(rows: F64, width: int) -> F64:
    """Gram matrix of each `width` rows that follow one another, (rows/width, width, width)."""
    if width == 1:
        return np.asarray(np.einsum("ij,ij->i", rows, rows))[:, None, None]
    blocks = rows.reshape(len(rows) // width, width, rows.shape[1])
    return np.asarray(blocks @ np.swapaxes(blocks, 1, 2))
