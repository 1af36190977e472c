"""Machines without one or two of X, Y, Z: the live step against 4×4 matrices written out apart."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from tests.support.compcore.five_axis import (
    TOOL,
    chain,
    errors_of,
    machine_of,
    model_of,
    row,
    somewhere,
)

CODES = ["w b Z X t", "w Y' b Z t", "w b X t", "w C' b Z X t", "w b B Z X t", "w b C Z t"]


@pytest.mark.parametrize("composition", ["exact", "first-order"])
@pytest.mark.parametrize("code", CODES)
def test_a_step_is_the_least_squares_of_the_axes_that_are_there(code, composition):
    """Rigid bodies one by one; what the axes do by differences; NumPy's least squares."""
    machine = machine_of(code)
    errors = errors_of(machine)
    compensator = Compensator(model_of(machine, errors, composition), tool=TOOL)
    target = somewhere(machine, 60)
    linear = [a for a in "XYZ" if a in machine.structure.linear]
    rows = np.stack([target[a] for a in machine.structure.axes], axis=1)
    batch = compensator.errors(rows)
    for i in range(60):
        q = row(target, i)
        nominal = chain(machine, None, q, TOOL)[0]
        error = chain(machine, errors, q, TOOL)[0] - nominal
        ways = [chain(machine, None, q | {a: q[a] + 1.0}, TOOL)[0] - nominal for a in linear]
        wanted = np.zeros(3)
        wanted[["XYZ".index(a) for a in linear]] = np.linalg.lstsq(np.array(ways).T, error)[0]
        found = compensator.step(rows[i].tolist())
        np.testing.assert_allclose(found, wanted, atol=1.5e-5)
        np.testing.assert_allclose(batch[i], found, atol=1e-12)


def test_what_is_commanded_is_reached_as_far_as_the_axes_reach():
    machine = machine_of("w C' b Z X t")
    errors = errors_of(machine)
    compensator = Compensator(model_of(machine, errors), tool=TOOL, tolerance_mm=1e-7)
    target = somewhere(machine, 20)
    rows = np.stack([target[a] for a in machine.structure.axes], axis=1)
    found = compensator.command(rows)
    for i in range(20):
        q = row(target, i)
        c = dict(zip(machine.structure.axes, found.positions[i].tolist(), strict=True))
        assert c["C"] == q["C"]
        away = chain(machine, errors, c, TOOL)[0] - chain(machine, None, q, TOOL)[0]
        back = np.array([[np.cos(q["C"]), np.sin(q["C"])], [-np.sin(q["C"]), np.cos(q["C"])]])
        # in the bed's axes: Y alone is left
        assert abs((back.T @ away[:2])[0]) < 1e-4 or abs((back @ away[:2])[0]) < 1e-4
        assert abs(away[2]) < 1e-6


@pytest.mark.parametrize("code", ["w b C B t", "w b C B A t"])
def test_a_machine_of_rotary_axes_alone_has_nothing_that_carries_a_correction(code):
    machine = machine_of(code)
    with pytest.raises(InputError, match="no axis X, Y or Z that could carry a correction"):
        Compensator(model_of(machine, errors_of(machine)))


def test_a_rotary_axis_whose_move_nothing_takes_back_is_not_corrected():
    machine = machine_of("w C' b Z X t")
    with pytest.raises(InputError, match="lacks an axis X, Y or Z that takes that back"):
        Compensator(model_of(machine, errors_of(machine)), turning=["C"])


def test_conditions_of_axes_that_are_missing_are_not_asked_for():
    machine = machine_of("w b Z X t")
    model = model_of(machine, errors_of(machine))
    error = model.axis_error(Conditions.at({"X": 100.0, "Z": -50.0}))
    assert not error["Y"].any()
    assert error["X"].any()
