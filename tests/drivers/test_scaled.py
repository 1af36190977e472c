"""Numbers that stand for values in a unit."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from abbe.drivers.scaled import ScaledNumber


def test_there_and_back():
    found = ScaledNumber(scale=-0.1, offset=20.0, unit="degC")
    assert found.value_of(30.0) == pytest.approx(17.0)
    assert found.number_of(17.0) == pytest.approx(30.0)


def test_a_negative_scale_turns_the_range_round():
    assert ScaledNumber(scale=-2.0, offset=1.0).range_of(-10.0, 20.0) == (-39.0, 21.0)


def test_only_what_is_scaled_is_said():
    assert ScaledNumber().scaling == ()
    assert ScaledNumber(scale=0.1).scaling == ("× 0.1",)
    assert ScaledNumber(scale=0.1, offset=20.0).scaling == ("× 0.1 + 20",)


def test_a_scale_that_cannot_be_taken_back():
    with pytest.raises(ValidationError, match="scale is 0"):
        ScaledNumber(scale=0.0)
