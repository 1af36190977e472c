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
