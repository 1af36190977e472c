"""The published worked example of applying a compensation map, figure for figure.

Chain YXZ, point (200, 600, −150). Lengths in mm, angles in rad; the values at
these positions are typed in here, so that neither a reader nor an interpolation can hide an error.
"""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, exact, exact_steps, first_order
from tests.support.compcore.machines import machine, motions

AT = {
    "Y": [0.0090, 0.1200, 0.0180, 0.021e-3, 0.024e-3, 0.027e-3],
    "X": [0.0100, 0.0200, 0.0300, 0.040e-3, 0.050e-3, 0.060e-3],
    "Z": [0.0390, 0.0330, 0.0360, 0.039e-3, 0.042e-3, 0.045e-3],
}
SUMS = [
    ("L of Y", (0.0090, 0.1200, 0.0180)),
    ("R up to Y", (0.0090, 0.1254, 0.0132)),
    ("L of X", (0.0190, 0.1454, 0.0432)),
    ("R up to X", (0.0079, 0.1545, 0.0432)),
    ("L of Z", (0.0469, 0.1875, 0.0792)),
]


@pytest.fixture
def chain():
    return Chain(machine(), Conditions.at({"X": 200.0, "Y": 600.0, "Z": -150.0}))


@pytest.fixture
def errors():
    return motions({axis: np.array([row]) for axis, row in AT.items()})


def test_every_intermediate_sum_to_four_decimals(chain, errors):
    _, _, steps = exact_steps(chain, errors)
    assert [name for name, _ in steps] == [*(name for name, _ in SUMS), "R up to Z"]
    for (name, got), (_, expected) in zip(steps, SUMS, strict=False):
        np.testing.assert_array_equal(np.round(got[0], 4), expected, name)


def test_compensated_point_and_orientation(chain, errors):
    total, orientation = exact(chain, errors)
    compensated = np.array([200.0, 600.0, -150.0]) + total[0]
    np.testing.assert_array_equal(np.round(compensated, 4), (200.0469, 600.1875, -149.9208))
    turn = orientation[0]
    np.testing.assert_allclose(
        [turn[1, 0], turn[0, 2], turn[2, 1]], [132e-6, 116e-6, 100e-6], atol=0.5e-7
    )
    np.testing.assert_allclose(
        [turn[0, 1], turn[2, 0], turn[1, 2]], [-132e-6, -116e-6, -100e-6], atol=0.5e-7
    )
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)


def test_first_order_gives_the_same_four_decimals(chain, errors):
    translation, rotation = first_order(chain, errors)
    np.testing.assert_allclose(translation[0], (0.0469, 0.1875, 0.0792), atol=0.55e-4)
    np.testing.assert_allclose(rotation[0], (100e-6, 116e-6, 132e-6), atol=1e-15)


def test_probe_tip_is_turned_by_the_orientation_at_the_ram(errors):
    tool = np.array([30.0, -20.0, -120.0])
    bare = Chain(machine(), Conditions.at({"X": 200.0, "Y": 600.0, "Z": -150.0}))
    probe = Chain(machine(), Conditions.at({"X": 200.0, "Y": 600.0, "Z": -150.0}, tool=tool))
    total, orientation = exact(bare, errors)
    with_tip, same = exact(probe, errors)
    np.testing.assert_allclose(same, orientation)
    np.testing.assert_allclose(with_tip[0], total[0] + orientation[0] @ tool - tool, atol=1e-15)
