"""Linear algebra: a singular value decomposition that does not give up, and its threads.

LAPACK's divide-and-conquer (gesdd, which NumPy calls) fails now and then on well-behaved matrices
whose singular values come in clusters, as those of orthonormal columns do. The older QR iteration
(gesvd) does not; it takes over then.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

F64 = NDArray[np.float64]

WORTH_MORE = 20_000_000
"""Elements of a matrix from which several threads pay even on a machine that is busy."""


class Singular(NamedTuple):
    """``a = u · diag(s) · vt``."""

    u: F64
    s: F64
    vt: F64


def svd(a: F64, *, full: bool = False) -> Singular:
    """Singular value decomposition of finite (m, n) numbers, the largest value first.

    Parameters
    ----------
    a
        The matrix.
    full
        Whether u and vt are square; else they have min(m, n) columns and rows.

    Raises
    ------
    ValueError
        For numbers that are not finite.
    """
    try:
        u, s, vt = np.linalg.svd(a, full_matrices=full)
    except np.linalg.LinAlgError:
        # half of most commands' start, for those that need it
        from scipy import linalg

        u, s, vt = linalg.svd(a, full_matrices=full, lapack_driver="gesvd")
    return Singular(u, s, vt)


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def threads_for(elements: int) -> Iterator[None]:
    """Run with one thread for matrices of fewer than `WORTH_MORE` elements.

    Where other processes want the cores too (a daemon in its cycle, a CAM system), the threads of a
    BLAS wait for each other thousands of times a second: small factorisations then take ten times
    as long as with one.
    """
    if elements >= WORTH_MORE:
        yield
        return
    with _controller().limit(limits=1, user_api="blas"):
        yield
