"""Rigid bodies as a national metrology institute writes them: four kinds of CMM, the same errors.

The Measurement Standards Laboratory of New Zealand publishes an application that shows what 21
error components do to ball plates and step gauges (MSLNZ/ls_cmm_error_map, c337a60). The numbers
are what its function gives for the slopes below, in µm; none of its code is here.
"""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.machine.conditions import Conditions
from tests.support.compcore.five_axis import NODES, machine_of, model_of

SLOPES = {
    "X": (13.3, -4.1, 2.7, 7.5e-3, 15.4e-3, 5.0e-3),
    "Y": (-11.2, -5.1, 3.3, -4.6e-3, -14.3e-3, 21.9e-3),
    "Z": (26.0, 4.6, -8.2, 2.5e-3, -9.4e-3, 47.8e-3),
}
"""Of X, Y, Z in ppm, of A, B, C in µrad per mm of each axis's travel."""
TOOL = (30.0, -20.0, -150.0)
PLACES = {
    "X": np.array([120.0, 430.0, 310.0]),
    "Y": np.array([-150.0, 60.0, 180.0]),
    "Z": np.array([-40.0, -260.0, -120.0]),
}
SAID = {
    "w b Y X Z t": [
        [1.329, -0.1560, -0.2613],
        [-4.6221, -1.8573, 3.5678],
        [-1.7811, -1.1671, 3.0892],
    ],
    "w b X Y Z t": [
        [1.419, 0.2382, -0.1389],
        [-4.7511, -2.4224, 3.3923],
        [-2.0601, -2.3892, 2.7097],
    ],
    "w Y' b X Z t": [
        [0.8362, -0.1560, -0.3648],
        [-4.7009, -1.8573, 3.5512],
        [-2.4906, -1.1671, 2.9401],
    ],
    "w X' b Y Z t": [
        [1.419, 0.3102, -0.3606],
        [-4.7511, -1.4979, 0.5448],
        [-2.0601, -1.9086, 1.2298],
    ],
}
"""Moving bridge (X, then Y across it), fixed bridge over a moving table (Y', then X')."""


@pytest.mark.parametrize("composition", ["first-order", "exact"])
@pytest.mark.parametrize("code", SAID)
def test_the_error_at_the_tip_is_the_institutes(code, composition):
    machine = machine_of(code)
    errors = {a: 1e-6 * np.outer(SLOPES[a], NODES[a]) for a in machine.structure.axes}
    model = model_of(machine, errors, composition)
    found = model.predict(Conditions.at(PLACES, tool=TOOL)).translation
    np.testing.assert_allclose(1e3 * found, SAID[code], atol=2e-4)
