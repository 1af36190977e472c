"""Numbers that nothing on a machine can have: refused at reading, with the row and the range."""

from __future__ import annotations

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Signal
from abbe.compcore.machine.plausible import Range, position_range, signal_range
from tests.support.compcore.campaign_texts import CMM, HEADER, MILL, good_lines, read_text

ROW = HEADER + 2
FIELDS = good_lines()[HEADER - 1].split(",")


def with_cells(cells: dict[str, str], line: int = ROW) -> str:
    """The good file with some cells of a row changed."""
    lines = good_lines()
    row = lines[line - 1].split(",")
    for column, text in cells.items():
        row[FIELDS.index(column)] = text
    lines[line - 1] = ",".join(row)
    return "\n".join(lines) + "\n"


BAD = [
    # column, text, row, words of what was expected
    ("time", "1e308", ROW, "s"),
    ("X", "1e308", ROW, "axis X travels from 0 to 700"),
    ("X", "1e6", ROW, "-350 to 1050 mm"),
    ("Z", "-600", ROW, "-540 to 180 mm"),
    ("tool_z", "1e300", ROW, "-5000 to 5000 mm"),
    ("tool_x", "-1e5", ROW, "-5000 to 5000 mm"),
    ("value", "1e308", ROW, "um for a displacement"),
    ("value", "-412345.678", ROW, "um for a displacement"),
    ("value", "3e5", ROW + 1, "urad for a rotation"),
    ("value", "412345678", ROW + 2, "mm for a distance"),
    ("T_x", "293.27", ROW, "-30 to 100 degC (a signal of role scale)"),
    ("T_x", "-273.15", ROW, "degC"),
    ("T_amb", "1e308", ROW, "-1e+15 to 1e+15"),
    ("sd", "1e-300", ROW, "um for a displacement"),
    ("sd", "1e300", ROW, "um for a displacement"),
    ("sd", "600", ROW + 2, "mm for a distance"),
]


@pytest.mark.parametrize(("column", "text", "line", "expected"), BAD)
def test_what_cannot_be_is_refused_with_its_place(tmp_path, column, text, line, expected):
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, with_cells({column: text}, line), CMM)
    error = caught.value
    assert (error.line, error.field, error.found) == (line, column, text)
    assert "\n" not in str(error)
    assert expected in (error.expected or "")


@pytest.mark.parametrize(
    ("section", "number"), [("offset", "[0.0, 0.0, 1e300]"), ("position", "[1e7, 20.0, -400.0]")]
)
def test_places_in_the_metadata_too(tmp_path, section, number):
    lines = good_lines()
    at = next(i for i, line in enumerate(lines) if line.startswith(f"# {section}"))
    lines[at] = f"# {section} = {number}"
    with pytest.raises(InputError, match="not believable") as caught:
        read_text(tmp_path, "\n".join(lines) + "\n", CMM)
    assert caught.value.line == at + 1


def test_uncertainties_that_cannot_be_weighed_together(tmp_path):
    text = with_cells({"sd": "1e-6"})
    text = text.replace("1.5,x_pos_1", "1.6,x_pos_1", 1) + text.splitlines()[HEADER].replace(
        ",0.5,", ",90000,"
    )
    with pytest.raises(InputError, match="to be weighed with them") as caught:
        read_text(tmp_path, text, CMM)
    assert (caught.value.line, caught.value.found) == (HEADER + 6, "90000")


@pytest.mark.parametrize(
    "cells",
    [
        {"X": "-300"},  # a set-up beyond the travel, within half of it
        {"value": "90000"},  # µm with a factor of 1000 too many: diagnosis names it
        {"T_x": "-20"},
        {"time": "1790000000"},  # seconds since 1970
        {"sd": "0.001"},
    ],
)
def test_what_is_only_unusual_is_read(tmp_path, cells):
    read_text(tmp_path, with_cells(cells), CMM)


def test_a_rotary_axis_may_be_counted_on():
    axis = MILL.axes["B"]
    allowed = position_range(axis)
    assert allowed.unit == "degrees"
    assert allowed.holds(400.0)
    assert allowed.holds(4000.0)
    assert not allowed.holds(4e4)
    assert position_range(Axis("X", (0.0, 10.0))) == Range(-50.0, 60.0, "mm", 1e4)


def test_a_signal_is_judged_by_its_role_and_unit():
    kelvin = Signal("T", "K", "scale")
    assert signal_range(kelvin).holds(293.0)
    assert not signal_range(Signal("T", "°C", "spindle")).holds(293.0)
    assert signal_range(Signal("T", "degC", "spindle")).holds(150.0)
    assert not signal_range(Signal("h", "%", "air")).holds(-5.0)
    assert signal_range(Signal("l", "%", "load")).holds(-120.0)
    assert signal_range(Signal("T", "degC", "structure")).rate < 40.0  # 20 → 60 °C in a sample
