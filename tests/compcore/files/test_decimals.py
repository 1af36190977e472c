"""Decimals read all at once are Python's own floats, to the last bit."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from abbe.compcore.files.campaign_csv.decimals import parse_decimals

DECIMALS = st.from_regex(r"-?(\d{1,12}(\.\d{0,12})?|\.\d{1,12})", fullmatch=True).filter(
    str.isascii
)
NUMBERS = st.one_of(
    DECIMALS,
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(10**19), 10**19).map(str),
    st.sampled_from(
        ["-0", "+1.5", " 2 ", "1e-5", "1E5", "", "-.5", "5.", "0.1", "9007199254740993"]
    ),
)


def parsed(cells: list[str]) -> np.ndarray | None:
    """The cells read as one line of a file."""
    text = ",".join(cells).encode() + b"\n"
    ends = np.cumsum([len(c.encode()) + 1 for c in cells]) - 1
    starts = np.r_[0, ends[:-1] + 1]
    return parse_decimals(text, starts, ends)


@given(st.lists(NUMBERS, min_size=1, max_size=30))
@example(["0.3", "123456789012345678", "1.7976931348623157e308", "4.9e-324", "-0.0"])
def test_as_python_reads_them(cells):
    expected = np.array([float(c) if c.strip() else np.nan for c in cells])
    if any(c and not c.strip() for c in cells):
        return
    found = parsed(cells)
    assert found is not None
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


@given(st.text(max_size=6).filter(lambda t: not {",", "\n"} & set(t)))
@example("1_0")
@example("nan")
@example("inf")
@example("1e999")
@example("-")
@example(".")
@example("1.2.3")
@example("--1")
@example("1-")
@example("٣")
@example("0x1")
def test_whatever_is_no_number_is_refused(text):
    try:
        value = float(text) if "_" not in text and text.isascii() else np.nan
    except ValueError:
        value = np.nan
    found = parsed(["1.5", text])
    if not text:
        assert found is not None
        assert np.isnan(found[1])
    elif np.isfinite(value):
        assert found is not None
        assert found[1] == value
    else:
        assert found is None


@pytest.mark.parametrize("digits", range(1, 25))
def test_numbers_of_any_length(digits):
    text = ("1234567890" * 3)[:digits]
    found = parsed([text, f"-{text}", f"0.{text}", f"{text}.5"])
    assert found is not None
    assert found.tolist() == [float(text), -float(text), float("0." + text), float(text + ".5")]
