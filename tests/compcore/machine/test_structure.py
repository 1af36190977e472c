from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.errors import InputError
from abbe.compcore.machine.structure import ROTARY, Structure, is_rotary


def test_moving_bridge():
    s = Structure.parse("w b Y X Z t")
    assert s == Structure((), ("Y", "X", "Z"))
    assert s.axes == s.linear == ("Y", "X", "Z")
    assert s.rotary == ()


def test_five_axis_mill_with_a_spindle():
    s = Structure.parse("w X' b Y Z C B (C) t")
    assert (s.workpiece_side, s.tool_side, s.spindle) == (("X",), ("Y", "Z", "C", "B"), "C")
    assert (s.linear, s.rotary, s.spindle_on_workpiece) == (("X", "Y", "Z"), ("C", "B"), False)


def test_lathe_has_its_spindle_on_the_workpiece_side():
    s = Structure.parse("w (C') b Z X t")
    assert (s.workpiece_side, s.tool_side, s.spindle) == ((), ("Z", "X"), "C")
    assert s.spindle_on_workpiece
    assert str(s) == "w (C') b Z X t"


@pytest.mark.parametrize(
    "code",
    [
        "[w Z' b X Y t]",
        "wZ'bXYt",
        "w Z’ b X Y t",
        "w-Z'-b-X-Y-t",
        "  w  Z'  b X  Y t  ",
        "w Z′ b X Y t",
    ],
)
def test_spellings_of_one_structure(code):
    assert str(Structure.parse(code)) == "w Z' b X Y t"


def test_numbered_axes():
    assert Structure.parse("w X1' b X2 Y Z t").axes == ("X1", "X2", "Y", "Z")


@st.composite
def structures(draw):
    names = draw(st.lists(st.sampled_from("XYZUVW" + ROTARY), unique=True, min_size=1, max_size=7))
    cut = draw(st.integers(0, len(names)))
    spindle = draw(st.sampled_from([None, *ROTARY]))
    on_workpiece = spindle is not None and draw(st.booleans())
    return Structure(tuple(names[:cut]), tuple(names[cut:]), spindle, on_workpiece)


@given(structures())
def test_round_trip(structure):
    assert Structure.parse(str(structure)) == structure
    assert set(structure.linear) | set(structure.rotary) == set(structure.axes)
    assert all(is_rotary(a) for a in structure.rotary)


@given(structures())
def test_spaces_do_not_matter(structure):
    assert Structure.parse(str(structure).replace(" ", "")) == structure


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("w b Y X Z", "t missing"),
        ("b Y X Z t", "'b' stands in the wrong place"),
        ("w X' Y' t", "'t' stands in the wrong place"),
        ("", "w b t missing"),
        ("w b t", "no axes"),
        ("w X b Y Z t", "axis X is on the workpiece side of b and needs a prime: X'"),
        ("w b Y' X Z t", "axis Y' is on the tool side of b and must have no prime"),
        ("w b Y X Y t", "axis Y occurs twice"),
        ("w X' b X Z t", "axis X occurs twice"),
        ("w b Y X Q t", "cannot read 'Q'"),
        ("w b Y X Z t W", "axis W stands outside w … t"),
        ("X w b Y t", "axis X stands outside w … t"),
        ("w b Y (X) t", "a spindle turns: (X) is a linear axis"),
        ("w b Y (C) (B) t", "more than one spindle"),
        ("w b Y (C) X t", "axis X stands between the spindle and the tool"),
        ("w b Y (C t", "cannot read '(C'"),
        ("w w b Y t", "'w' stands in the wrong place"),
    ],
)
def test_errors_name_the_offending_piece(code, message):
    with pytest.raises(InputError) as caught:
        Structure.parse(code)
    assert message in str(caught.value)
    assert caught.value.field == "structure"
    assert caught.value.found == code
    assert "w b Y X Z t" in caught.value.expected
