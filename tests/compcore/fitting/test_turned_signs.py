"""All signs turned at the first fit, °F in a column of temperatures: seen, and asked about."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.effects import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from benchmarks.sources.campaigns import Rows

MACHINE = Machine(
    "", Structure.parse("w b X Y Z t"), {a: Axis(a, (0.0, 600.0)) for a in "XYZ"},
    {"T_x": Signal("T_x", role="scale", axis="X")},
)  # fmt: skip
STEEL = 11.5e-6


def lines(sign: float, fahrenheit: bool = False):
    """A steel scale along X, cold and warm: laser minus machine is α·(T − 20)·x."""
    rng = np.random.default_rng(4)
    rows = Rows(("X", "Y", "Z"))
    x = np.linspace(0.0, 600.0, 21)
    for celsius in (18.0, 24.0):
        value = sign * STEEL * (celsius - 20.0) * x + rng.normal(0.0, 2e-4, len(x))
        told = 1.8 * celsius + 32.0 if fahrenheit else celsius
        rows.add(f"at {celsius:g}", Kind.DISPLACEMENT, {"X": x}, value, 2e-4, u=(1.0, 0.0, 0.0),
                 signals={"T_x": told})  # fmt: skip
    return rows.campaign("laser")


def model() -> Model:
    return Model(MACHINE).with_effects(
        make_effect("scale_expansion", {"axis": "X", "signals": ["T_x"]})
    )


@pytest.mark.parametrize(("sign", "seen"), [(1.0, False), (-1.0, True)])
def test_a_scale_that_shrinks_as_it_warms_is_a_turned_sign(sign, seen):
    told = fit(model(), lines(sign)).suspicions
    assert any("shrinks as it warms (-11.5 ppm/K)" in s for s in told) is seen


def test_temperatures_that_could_be_fahrenheit_are_asked_about(tmp_path):
    rows = lines(1.0, fahrenheit=True)
    rows.conditions.signals["T_x"].setflags(write=True)
    rows.conditions.signals["T_x"][0] = 104.0  # 40 °C: no scale has 104 °C
    write_campaign(rows, tmp_path / "f.csv")
    with pytest.raises(InputError, match="were they recorded in °F"):
        read_campaign(tmp_path / "f.csv", MACHINE)
