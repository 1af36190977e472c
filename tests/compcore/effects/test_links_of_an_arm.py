"""What of an arm sags: each link towards the next joint that is parallel, by closed form."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import ErrorMotion
from abbe.compcore.effects.catalogue.gravity import GravityFlexure
from abbe.compcore.machine.conditions import Conditions
from tests.support.compcore.arm_points import PLACES, arm

SAG = 5e-4


@pytest.mark.parametrize(("joint", "to"), [("B2", 2), ("B3", 4)])
def test_a_link_turns_by_how_level_it_lies(joint: str, to: int) -> None:
    """About Y by sag times how far the link's end stands out, of its length."""
    machine = arm()
    angle = np.linspace(-1.5, 1.5, 7)
    at = {a: angle if a == joint else np.zeros(7) for a in machine.structure.axes}
    conditions = Conditions(at)
    (x, _, z) = PLACES[to] - PLACES[{"B2": 1, "B3": 2}[joint]]
    out = (x * np.cos(angle) + z * np.sin(angle)) / np.hypot(x, z)
    motions = GravityFlexure(axis=joint).motions(machine, conditions, {})
    about_y = next(m for m in motions if m.error_motion == ErrorMotion(joint, "B"))
    np.testing.assert_allclose(about_y.columns[:, 0] * SAG, SAG * out, atol=1e-12)
