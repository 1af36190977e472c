"""Thermometers asked about °F, or not: a bed that is heated, a scale that reads °F."""

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.suspicions import of_signals
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from benchmarks.sources.campaigns import Rows

MACHINE = Machine(
    "",
    Structure.parse("w b Y X Z t"),
    {n: Axis(n, (0.0, 300.0)) for n in "XYZ"},
    {"T": Signal("T", role="workpiece")},
)


@pytest.mark.parametrize(
    ("reads", "measured", "asked"),
    [
        (68.0, {}, True),
        (68.0, {"T": (23.0, 30.0)}, True),  # warmer than ever before
        (68.0, {"T": (19.0, 22.0)}, True),  # in °C until now
        (68.0, {"T": (64.0, 74.0)}, True),  # always in °F
        (68.0, {"T": (23.0, 105.0)}, False),  # heated from what can only be °C
        (21.0, {}, False),
    ],
)
def test_a_thermometer_that_may_read_fahrenheit(reads, measured, asked):
    rows = Rows(("X", "Y", "Z"))
    x = np.linspace(0.0, 300.0, 5)
    rows.add("line", Kind.DISPLACEMENT, {"X": x}, np.zeros(5), 1e-4, u=(1.0, 0.0, 0.0),
             signals={"T": reads})  # fmt: skip
    assert any("°F" in s for s in of_signals(rows.campaign("laser"), MACHINE, measured)) is asked


@pytest.mark.parametrize(
    ("before", "after", "seconds", "switched"),
    [
        (20.7, 69.1, 8.0, "to °F"),
        (69.1, 20.7, 8.0, "from °F to °C"),
        (20.7, 69.1, 400.0, None),  # a bed that was heated
        (20.7, 45.0, 8.0, None),  # no other unit of the same temperature
    ],
)
def test_a_thermometer_that_is_switched_in_the_middle(before, after, seconds, switched):
    rows = Rows(("X", "Y", "Z"))
    for k, reads in enumerate((before, after)):
        x = np.linspace(0.0, 300.0, 5)
        time = k * (32.0 + seconds) + np.arange(5) * 8.0
        rows.add("line", Kind.DISPLACEMENT, {"X": x}, np.zeros(5), 1e-4, u=(1.0, 0.0, 0.0),
                 signals={"T": reads}, time=time)  # fmt: skip
    found = list(of_signals(rows.campaign("laser"), MACHINE, {"T": (20.0, 75.0)}))
    found = [s for s in found if "switched" in s]
    assert len(found) == (switched is not None)
    assert all(f"switched {switched}?" in s for s in found)
