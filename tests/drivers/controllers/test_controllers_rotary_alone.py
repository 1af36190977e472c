"""A rotary table or an indexing head alone: its angle's table, in each control's own degrees."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import RotaryPositioning
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.tables.of_model import project_tables
from abbe.drivers.controllers import make_controller

TURN = 2.0 * np.pi
A1, B1, A2 = 30e-6, -20e-6, 10e-6
HOLD_IT = [
    ("linuxcnc", {}),
    ("linuxcnc", {"type": "1"}),
    ("siemens-840d", {}),
    ("siemens-840d", {"pitch": "cec"}),
    ("heidenhain-tnc", {}),
    ("fanuc", {}),
    ("pmac", {}),
    ("twincat-isg", {"form": "axes"}),
    ("twincat-isg", {}),
    ("etalon-exchange", {}),
    ("csv", {}),
    ("grid-csv", {}),
]
HOLD_NONE = ["cmm-map", "heidenhain-nd", "weihong"]


def table_alone(code: str = "w C' b t") -> Model:
    """Rotary axes whose encoder's ring is eccentric and oval."""
    structure = Structure.parse(code)
    machine = Machine("table", structure, {a: Axis(a, (0.0, TURN)) for a in structure.axes})
    values = {"A1": Value(A1), "B1": Value(B1), "A2": Value(A2), "B2": Value(0.0)}
    terms = [Term(RotaryPositioning(axis=a), values) for a in structure.rotary]
    return Model(machine, tuple(terms))


def truth(turn):
    """The angle's error, rad, by hand."""
    return A1 * np.cos(turn) + B1 * np.sin(turn) + A2 * np.cos(2.0 * turn)


def less_constant(values):
    return values - values.mean()


@pytest.mark.parametrize(("dialect", "options"), HOLD_IT)
@pytest.mark.parametrize(("code", "axis"), [("w C' b t", "C"), ("w b A t", "A")])
def test_its_angle_is_held_and_read_back(dialect, options, code, axis) -> None:
    """A constant is the reference point's; the rest is the error, interpolated within its step."""
    model = table_alone(code)
    controller = make_controller(dialect, model.machine, options)
    read = controller.read(controller.write(project_tables(model, controller.capability).tables))
    [own] = [t for t in read if t.output.component == axis]
    at = np.linspace(0.0, TURN, 145)
    left = less_constant(own.at(at) - truth(at))
    # a Fanuc's detection unit is a thousandth of a degree; a grid has eleven positions
    most = {"fanuc": 1.1 * np.radians(1e-3), "grid-csv": 5e-6}.get(dialect, 2e-6)
    assert np.abs(left).max() < most
    assert np.abs(less_constant(truth(at))).max() > 35e-6
    others = [t for t in read if t is not own]
    assert all(np.abs(t.forward).max() < 1e-9 for t in others)


def test_linuxcnc_has_degrees() -> None:
    """Nominal and where it is found, degrees; the trim turns the sign."""
    model = table_alone()
    for kind in ("0", "1"):
        controller = make_controller("linuxcnc", model.machine, {"type": kind})
        tables = project_tables(model, controller.capability, points=200).tables
        rows = np.array([line.split() for line in controller.write(tables)["c.comp"].splitlines()],
                        dtype=float)  # fmt: skip
        error = np.degrees(truth(np.radians(rows[:, 0])))
        expected = rows[:, 0] + error if kind == "0" else -error
        assert np.abs(rows[:, 1] - expected).max() < np.degrees(0.2e-6)
        assert (rows[0, 0], rows[-1, 0]) == (0.0, 360.0)


def test_two_axes_have_a_table_each() -> None:
    model = table_alone("w C' A' b t")
    controller = make_controller("siemens-840d", model.machine, {})
    tables = project_tables(model, controller.capability).tables
    assert {t.name for t in tables} == {"E_CC", "E_AA"}


@pytest.mark.parametrize("dialect", HOLD_NONE)
def test_who_has_no_table_for_an_angle_says_so(dialect) -> None:
    model = table_alone()
    with pytest.raises(InputError, match="rotary axes only, and this controller has no table for"):
        project_tables(model, make_controller(dialect, model.machine, {}).capability)


def test_an_arm_is_no_table() -> None:
    model = table_alone("w b C B A t")
    with pytest.raises(InputError, match="no axis X, Y or Z that could carry a correction"):
        project_tables(model, make_controller("linuxcnc", model.machine, {}).capability)
