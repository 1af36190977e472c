from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine, Signal, nominal_direction, own_component
from abbe.compcore.machine.structure import Structure

BRIDGE = Structure.parse("w b Y X Z t")
AXES = {a: Axis(a, (0.0, 100.0)) for a in "XYZ"}


def test_middle_half_travel_and_clamp():
    axis = Axis("Z", (-360.0, 40.0))
    assert (axis.middle, axis.half_travel) == (-160.0, 200.0)
    assert axis.clamp(np.array([-500.0, -360.0, 0.0, 41.0])).tolist() == [-360.0, -360.0, 0.0, 40.0]


@pytest.mark.parametrize(
    ("name", "direction", "component", "rotary"),
    [
        ("X", (1, 0, 0), "X", False),
        ("V", (0, 1, 0), "Y", False),
        ("W", (0, 0, 1), "Z", False),
        ("Z2", (0, 0, 1), "Z", False),
        ("A", (1, 0, 0), "A", True),
        ("B1", (0, 1, 0), "B", True),
        ("C", (0, 0, 1), "C", True),
    ],
)
def test_what_a_name_implies(name, direction, component, rotary):
    assert nominal_direction(name) == direction
    assert own_component(name) == component
    assert Axis(name, (0.0, 1.0)).rotary is rotary
    assert Axis(name, (0.0, 1.0)).direction == direction


@pytest.mark.parametrize("travel", [(1.0, 1.0), (5.0, 0.0)])
def test_travel_must_rise(travel):
    with pytest.raises(InputError, match=r"machine\.axes\.X\.travel.*lower to the higher"):
        Axis("X", travel)


def test_direction_must_have_length_one():
    with pytest.raises(InputError, match="not a unit vector"):
        Axis("X", (0.0, 1.0), direction=(1.0, 1.0, 0.0))


def test_axes_and_structure_name_the_same_axes():
    with pytest.raises(InputError, match="axis Z is in the structure code but has no section"):
        Machine("m", BRIDGE, {a: AXES[a] for a in "XY"})
    with pytest.raises(InputError, match="axis W is not in the structure code.*one of Y, X, Z"):
        Machine("m", BRIDGE, {**AXES, "W": Axis("W", (0.0, 1.0))})


def test_signals_are_checked():
    with pytest.raises(InputError, match="unknown role.*found 'scael'.*scale"):
        Machine("m", BRIDGE, AXES, {"T": Signal("T", role="scael")})
    with pytest.raises(InputError, match="no such axis.*found 'W'"):
        Machine("m", BRIDGE, AXES, {"T": Signal("T", axis="W")})
    assert Signal("T").temperature
    assert not Signal("p", unit="hPa").temperature


def test_an_unknown_axis_lists_those_there_are():
    with pytest.raises(InputError, match="no such axis: found 'W', expected one of Y, X, Z"):
        Machine("m", BRIDGE, AXES).axis("W")


def test_own_move_in_lever_follows_the_side_unless_declared():
    structure = Structure.parse("w X' b Y Z t")
    axes = {**AXES, "Z": Axis("Z", (0.0, 1.0), error_acts="before")}
    machine = Machine("m", structure, axes)
    assert [machine.own_move_in_lever(a) for a in "XYZ"] == [True, False, True]
    declared = Machine("m", structure, {**AXES, "X": Axis("X", (0.0, 1.0), error_acts="after")})
    assert not declared.own_move_in_lever("X")
