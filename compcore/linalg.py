"""The singular value decomposition, where the fast algorithm gives up too.

LAPACK's divide-and-conquer (gesdd, which NumPy calls) fails now and then on well-behaved matrices
whose singular values come in clusters, as those of orthonormal columns do. The older QR iteration
(gesvd) does not; it takes over then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

F64 = NDArray[np.float64]


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
        u, s, vt = linalg.svd(a, full_matrices=full, lapack_driver="gesvd")
    return Singular(u, s, vt)
