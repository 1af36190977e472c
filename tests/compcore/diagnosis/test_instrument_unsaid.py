"""A beam out of line that nobody called a laser's: a scale of its set-up, and what to say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import model

MACHINE = Machine(
    "gantry", Structure.parse("w b X Y Z t"), {n: Axis(n, (0.0, 3000.0)) for n in "XYZ"}
)


@pytest.mark.parametrize(("instrument", "named"), [(None, "setup_scale"), ("laser", "cosine")])
def test_what_only_a_laser_does_is_asked_of_a_laser(instrument: str | None, named: str) -> None:
    rng = np.random.default_rng(3)
    rows = Rows(("X", "Y", "Z"))
    x = np.linspace(0.0, 3000.0, 16)
    for name, ppm in (("low", 0.0), ("high", -10.0), ("low again", 0.0)):
        value = 2e-3 * np.sin(x / 700.0) + 1e-6 * ppm * x + rng.normal(0.0, 5e-4, 16)
        rows.add(name, Kind.DISPLACEMENT, {"X": x}, value, 5e-4, u=(1.0, 0.0, 0.0))
    campaign = replace(
        rows.campaign("lines"), metadata=[{"instrument": instrument}] if instrument else []
    )
    found = diagnose(model(MACHINE, "positioning axis=X shape=spline:8"), campaign)
    assert [e.effect.kind for e in found.established][:1] == [named]
    said = any("what measured" in line for line in found.words())
    assert said is (instrument is None)
