"""A vertical lathe whose rail is called R, beside X and Z: proposals go along its own axes."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.diagnosis.next_measurement.practicable import practicable
from abbe.compcore.diagnosis.screening.candidates import candidates
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from benchmarks.sources.campaigns import Rows


def test_no_diagonal_asks_for_an_axis_that_is_not_there() -> None:
    axes = {"R": (0.0, 1200.0), "X": (-100.0, 1600.0), "Z": (-900.0, 0.0)}
    lathe = Machine(
        "lathe", Structure.parse("w b R X Z t"), {a: Axis(a, t) for a, t in axes.items()}
    )
    rows = Rows(("R", "X", "Z"))
    for axis, (low, high) in axes.items():
        at = np.linspace(low, high, 9)
        rows.add(
            f"line {axis}", Kind.DISPLACEMENT, {axis: at}, np.zeros(9), 1e-4, u=(1.0, 0.0, 0.0)
        )
    proposals = list(practicable(lathe, rows.campaign("laser")))
    assert proposals
    assert not any("diagonal, X" in p.what for p in proposals)


@pytest.mark.parametrize("letter", ["R", "U", "V", "W", "X2"])
def test_every_cause_is_proposed_for_an_axis_of_any_letter(letter: str) -> None:
    axes = {letter: (0.0, 1200.0), "Z": (-900.0, 0.0)}
    machine = Machine(
        "rail",
        Structure.parse(f"w b {letter} Z t"),
        {a: Axis(a, travel) for a, travel in axes.items()},
    )
    rows = Rows((letter, "Z"))
    for axis, (low, high) in axes.items():
        at = np.linspace(low, high, 9)
        rows.add(
            f"line {axis}", Kind.DISPLACEMENT, {axis: at}, np.zeros(9), 1e-4, u=(1.0, 0.0, 0.0)
        )
    found = [c.effect for c in candidates(Model(machine, ()), rows.campaign("laser"))]
    own = {e.kind for e in found if getattr(e, "axis", "") == letter}
    assert {"positioning", "joint", "local_defect"} <= own
