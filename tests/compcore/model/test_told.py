"""Uncertain by all of what is plausible is not measured, whatever stands as the value."""

from __future__ import annotations

import pytest

from abbe.compcore.effects import Squareness
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Value
from abbe.compcore.model.told import not_told, untold

MACHINE = Machine("m", Structure.parse("w b X Y Z t"), {a: Axis(a, (0.0, 500.0)) for a in "XYZ"})


@pytest.mark.parametrize(
    ("value", "silent"),
    [
        (Value(0.0, 0.035), True),
        (Value(0.0, 21e-6), False),
        (Value(191e-6, 21e-6), False),
        (Value(0.05, 0.035), False),
        (Value(191e-6, 21e-6, measured=False), True),
        (Value(0.0, None), False),
    ],
)
def test_more_than_the_plausible_range_is_no_knowledge(value: Value, silent: bool):
    least = untold(Squareness(axes=("X", "Y")), MACHINE)["angle"]
    assert not_told(value, least) is silent
