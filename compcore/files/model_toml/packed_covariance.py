"""A symmetric matrix as text that a TOML file can hold: exact, and a quarter of the digits."""

from __future__ import annotations

import base64
import zlib

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError

F64 = NDArray[np.float64]


def pack_symmetric(matrix: F64) -> str:
    """The upper triangle, row by row, as little-endian float64, deflated, in base 64.

    `matrix` has shape (p, p).
    """
    upper = matrix[np.triu_indices(matrix.shape[0])].astype("<f8")
    return base64.b64encode(zlib.compress(upper.tobytes(), 6)).decode("ascii")


def unpack_symmetric(text: str, size: int) -> F64:
    """The reverse of `pack_symmetric`, shape (size, size).

    Raises
    ------
    InputError
        When the text is damaged or belongs to another number of parameters.
    """
    wanted = size * (size + 1) // 2
    try:
        packed = base64.b64decode(text, validate=True)
        # never more than one number beyond what belongs there: a short text may unpack to much
        stream = zlib.decompressobj()
        upper = np.frombuffer(stream.decompress(packed, 8 * (wanted + 1)), "<f8")
        if upper.size <= wanted and not stream.eof:
            raise ValueError("cut off")
    except (ValueError, zlib.error):
        raise InputError("the packed covariance is damaged", field="fit.covariance") from None
    if upper.size != wanted:
        raise InputError(
            "the covariance does not belong to these parameters",
            field="fit.covariance",
            found=f"{upper.size} numbers" + (" or more" if upper.size > wanted else ""),
            expected=f"{wanted} for {size} parameters",
        )
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = upper
    return np.asarray(matrix + np.triu(matrix, 1).T)
