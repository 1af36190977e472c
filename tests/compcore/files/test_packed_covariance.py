from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from abbe.compcore.errors import InputError
from abbe.compcore.files.model_toml.packed_covariance import pack_symmetric, unpack_symmetric


@given(
    st.integers(0, 12).flatmap(
        lambda p: arrays(np.float64, (p, p), elements=st.floats(allow_nan=False))
    )
)
def test_round_trip_is_exact(matrix):
    symmetric = np.triu(matrix) + np.triu(matrix, 1).T
    np.testing.assert_array_equal(
        unpack_symmetric(pack_symmetric(symmetric), len(symmetric)), symmetric
    )


def test_damage_is_said():
    text = pack_symmetric(np.eye(3))
    for damaged in (text[:-6], "?" + text[1:], "QUJD"):
        with pytest.raises(InputError, match=r"fit\.covariance.*damaged"):
            unpack_symmetric(damaged, 3)


def test_another_number_of_parameters_is_said():
    with pytest.raises(InputError, match="found '6 numbers', expected 10 for 4 parameters"):
        unpack_symmetric(pack_symmetric(np.eye(3)), 4)
