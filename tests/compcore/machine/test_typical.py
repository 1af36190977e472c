"""What signals commonly do: within what they can be, and one table for all who ask."""

from __future__ import annotations

import pytest

from abbe.compcore.machine.machine import Signal
from abbe.compcore.machine.plausible import signal_range
from abbe.compcore.machine.typical import _BY_UNIT, typical, typical_range
from tests.support.compcore.machines import machine


@pytest.mark.parametrize("unit", _BY_UNIT)
def test_what_is_common_is_possible(unit: str):
    signal = Signal("s", unit, "other")
    low, high = typical_range(signal, machine("w b Y X Z t"))
    assert low < high
    assert signal_range(signal).holds(low)
    assert signal_range(signal).holds(high)
    assert 0.0 < typical(signal).change <= high - low


@pytest.mark.parametrize(("one", "other"), [("°C", "degC"), ("1/min", "rpm"), ("min-1", "rpm")])
def test_a_units_spellings_mean_the_same(one: str, other: str):
    assert typical(Signal("s", one)) == typical(Signal("s", other))


def test_temperatures_stand_about_the_reference():
    assert typical_range(Signal("T", "degC"), machine("w b Y X Z t")) == (0.0, 40.0)


def test_an_unknown_unit():
    assert typical(Signal("s", "furlong")) == (-1.0, 1.0, 1.0)
