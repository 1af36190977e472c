"""Numbers in a campaign's rows are Python's own floats, to the last bit; others are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.columns import Columns
from abbe.compcore.files.campaign_csv.table import parse_rows

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


def parsed(*rows: list[str]) -> np.ndarray:
    """The numbers of rows in a file with as many signals."""
    header = tuple(f"s{i}" for i in range(len(rows[0])))
    columns = Columns(header, {}, {}, None, header, "day1.csv", 1)
    return parse_rows(2, [",".join(cells) for cells in rows], columns).numbers


@given(st.lists(NUMBERS, min_size=2, max_size=30))
@example(["0.3", "123456789012345678", "1.7976931348623157e308", "4.9e-324", "-0.0"])
@example(["", "", "1", "", "", ""])
def test_as_python_reads_them(cells):
    expected = np.array([float(c) if c.strip() else np.nan for c in cells])
    found = parsed(cells, cells[::-1])
    np.testing.assert_array_equal(found, [expected, expected[::-1]])
    np.testing.assert_array_equal(np.signbit(found[0]), np.signbit(expected))


@given(st.text(max_size=6).filter(lambda t: not {",", "\n", "\r", '"'} & set(t)))
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
@example("1.5\0")
@example("#")
def test_whatever_is_no_number_is_refused(text):
    try:
        value = float(text) if "_" not in text and text.isascii() else np.nan
    except ValueError:
        value = np.nan
    if not text.strip():
        assert np.isnan(parsed(["1.5", text])[0, 1])
    elif np.isfinite(value):
        assert parsed(["1.5", text])[0, 1] == value
    else:
        with pytest.raises(InputError, match=r"day1\.csv"):
            parsed(["1.5", text])


@pytest.mark.parametrize("digits", range(1, 25))
def test_numbers_of_any_length(digits):
    text = ("1234567890" * 3)[:digits]
    cells = [text, f"-{text}", f"0.{text}", f"{text}.5"]
    assert parsed(cells).tolist() == [[float(cell) for cell in cells]]
