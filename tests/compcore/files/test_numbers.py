"""Numbers in text: what is one, what is none, and what is not believable, with the place."""

from __future__ import annotations

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.map_file import parse_map
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.machine.plausible import Range
from tests.support.daemon.command_line import abbe

MAP = """X Axis
Position Lx Ly Lz Rx Ry Rz
0 0 0 0 0 0 0
{} 0.001 0 0 0 0 0
"""


@pytest.mark.parametrize(
    ("text", "value"),
    [("12", 12.0), ("-0.5", -0.5), ("+3.", 3.0), ("1e-3", 0.001), ("  7 ", 7.0), (".25", 0.25)],
)
def test_a_number(text: str, value: float) -> None:
    assert checked_number(text) == value


@pytest.mark.parametrize("text", ["", "abc", "1_000", "12,5", "nan", "inf", "-Infinity", "1e999"])
def test_what_is_no_number_is_named_with_its_place(text: str) -> None:
    with pytest.raises(InputError) as caught:
        checked_number(text, file="a.csv", line=7, field="dX", expected="a number in mm")
    expected = f"a.csv, line 7, field 'dX': not a number: found {text!r}, expected a number in mm"
    assert str(caught.value) == expected


def test_what_is_not_believable() -> None:
    allowed = Range(-10.0, 10.0, "mm")
    assert checked_number("-10", allowed=allowed) == -10.0
    with pytest.raises(InputError, match="not believable: found '10.1', expected "):
        checked_number("10.1", allowed=allowed)


def test_an_underscore_is_no_number_in_a_map_or_on_the_command_line() -> None:
    assert parse_map(MAP.format("1000")).tables["X"].positions == (0.0, 1000.0)
    with pytest.raises(InputError, match="line 4, field 'Position': not a number: found '1_000'"):
        parse_map(MAP.format("1_000"))
    done = abbe("correct", "tests/data/p01-mill/model.toml", "X=1_00", "Y=0", "Z=0")
    assert (done.status, done.out) == (1, "")
    assert "field 'X': not a number: found '1_00'" in done.err
