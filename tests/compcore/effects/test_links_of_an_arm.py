"""What of an arm sags, and how its column leans, by closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from abbe.compcore.effects import ErrorMotion
from abbe.compcore.effects.catalogue.gravity import GravityFlexure
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.arm_points import JOINTS, PLACES, arm, tips

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


@pytest.mark.parametrize("acts", ["before", "after"])
def test_a_column_leans_at_its_foot(acts: str) -> None:
    """The tip, its height on the column included, turns about the foot, by plain rotations."""
    there = arm()
    column = Axis("Z", (0.0, 2000.0), error_acts=acts)
    machine = Machine(
        "column", Structure.parse("w b Z " + " ".join(JOINTS) + " t"), {"Z": column, **there.axes}
    )
    rng = np.random.default_rng(199)
    q, height = rng.uniform(-1.5, 1.5, (9, 6)), rng.uniform(0.0, 2000.0, 9)
    tool = rng.uniform(-200.0, 200.0, (9, 3)) + PLACES[-1]
    at = {"Z": height} | {a: q[:, k] for k, a in enumerate(JOINTS)}
    effect = GravityFlexure(axis="Z", by="B2")
    effect.check(machine)
    model = Model(machine, (Term(effect, {"sag": Value(SAG)}),))
    told = model.predict(Conditions(at, tool=tool)).translation

    fore = Rotation.from_euler("ZY", q[:, :2]).apply([0.0, 0.0, 1.0])
    lean = SAG * np.cross(fore, [0.0, 0.0, -1.0])
    tip = tips(q, tool) + height[:, None] * [0.0, 0.0, 1.0]
    np.testing.assert_allclose(told, np.cross(lean, tip), atol=1e-9)
    # what hangs over falls
    over = np.argmax(np.abs(fore[:, :2]).sum(axis=1))
    assert np.cross(lean[over], fore[over])[2] < 0.0


def test_a_column_leans_only_under_an_arm() -> None:
    """What nothing holds out over is refused in words."""
    machine = Machine(
        "column",
        Structure.parse("w b Z " + " ".join(JOINTS) + " t"),
        {"Z": Axis("Z", (0.0, 2000.0)), **arm().axes},
    )
    with pytest.raises(InputError, match="rotary"):
        GravityFlexure(axis="Z").check(machine)
    with pytest.raises(InputError, match="the axis carries"):
        GravityFlexure(axis="Z", by="Z").check(machine)
