"""Errors of 10 mm and 50 mrad along an arm, against plain products of homogeneous transforms."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import ErrorMotion
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, exact
from tests.support.compcore.arm_points import JOINTS, arm, tips


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_joint_lies_where_those_before_it_have_turned_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.0, 2.0, (5, 6))
    tool = np.array([900.0, 0.0, 1332.0]) + rng.uniform(-100.0, 100.0, (5, 3))
    errors = np.hstack([rng.uniform(-10.0, 10.0, (6, 3)), rng.uniform(-0.05, 0.05, (6, 3))])
    at = Conditions({joint: q[:, k] for k, joint in enumerate(JOINTS)}, tool=tool)
    motions = {
        ErrorMotion(joint, component): np.full(5, errors[k, i])
        for k, joint in enumerate(JOINTS)
        for i, component in enumerate("XYZABC")
    }
    expected = tips(q, tool, errors) - tips(q, tool)
    np.testing.assert_allclose(exact(Chain(arm(), at), motions)[0], expected, atol=1e-9)
