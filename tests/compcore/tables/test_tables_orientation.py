"""Tables that turn rotary axes: against chains of 4×4 matrices, and against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.tables.capability import RIGID, Capability, Holds
from abbe.compcore.tables.field import ErrorField, table_state
from abbe.compcore.tables.projection.project import project
from abbe.compcore.tables.remainder import TrialPoints
from abbe.compcore.tables.table import Sign
from abbe.compcore.tables.volume import Volume
from abbe.drivers.controllers import make_controller
from tests.support.compcore.five_axis import (
    CODES,
    NODES,
    TOOL,
    angle,
    chain,
    errors_of,
    machine_of,
    model_of,
    row,
    somewhere,
)

SINGLE = Capability(
    (
        Holds("axis", ("L-POS", "R-POS"), points=2000),
        Holds("cross", ("L-STR", "R-RAX", "FOR"), points=2000),
    )
)


def field_of(name, errors):
    machine = machine_of(CODES[name])
    model = model_of(machine, errors)
    return machine, ErrorField(model, table_state(model, {}, tool=TOOL), "command")


def separable():
    """Errors that turn the tool about B and C only, each by one axis's position."""
    machine = machine_of(CODES["mixed"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    rng = np.random.default_rng(12)
    for axis, motion in (("X", 4), ("Z", 4), ("B", 4), ("C", 5)):
        errors[axis][motion] = rng.uniform(-6e-5, 6e-5, 7)
    for axis, motion in (("X", 0), ("Y", 1), ("Z", 2)):
        errors[axis][motion] = rng.uniform(-4e-3, 4e-3, 7)
    return errors


def commanded(tables, target):
    """What a controller commands that looks tables up at the target and adds them up."""
    moved = dict(target)
    for table in tables:
        assert table.sign is Sign.ERROR
        (axis,) = table.inputs
        error = np.interp(target[axis], table.nodes[0], table.forward)
        output = table.output.component if table.direct else table.output.place
        moved[output] -= error
    return moved


def poses(machine, errors, tables, n=40):
    """Distances from the wanted point (mm) and lean (rad), with tables and without, (n, 2) each."""
    where = somewhere(machine, n, seed=5)
    found = []
    for i in range(n):
        target = row(where, i)
        point, direction = chain(machine, None, target, TOOL)
        for q in (target, commanded(tables, target)):
            p, d = chain(machine, errors, q, TOOL)
            found.append((np.linalg.norm(p - point), angle(d, direction)))
    return np.array(found).reshape(n, 2, 2)


def test_what_tables_can_hold_of_the_direction_they_hold():
    errors = separable()
    machine, field = field_of("mixed", errors)
    made = project(field, Volume.of(machine), SINGLE, orientation=True)
    names = {t.name for t in made.tables}
    assert {"E_BB", "E_CC", "E_BB(X)", "E_BB(Z)"} <= names
    assert not {"E_CC(X)", "E_CC(Z)", "E_BB(C)"} & names
    found = poses(machine, errors, made.tables)
    assert found[:, 0, 1].max() > 5e-5
    assert found[:, 1, 1].max() < 5e-7
    assert np.sqrt((found[:, 1, 0] ** 2).mean()) < 0.35 * np.sqrt((found[:, 0, 0] ** 2).mean())
    left = TrialPoints.over(field, Volume.of(machine)).remainder(made.tables)
    assert left.lean_largest == pytest.approx(0.0, abs=5e-7)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", ["head-head", "table-table", "mixed"])
def test_of_a_direction_that_they_cannot_hold_they_leave_least(name):
    """Brute force: least squares of piecewise linear functions of single axes, for all at once."""
    machine = machine_of(CODES[name])
    errors = errors_of(machine)
    _, field = field_of(name, errors)
    volume = Volume.of(machine)
    made = project(field, volume, SINGLE, orientation=True)
    turning = [t for t in made.tables if t.output.rotation]
    n = 3000
    where = somewhere(machine, n, seed=9)
    axis = "AB"[name != "table-table"]
    tilt, columns = np.empty((n, 3)), []
    for i in range(n):
        q = row(where, i)
        wanted = chain(machine, None, q, TOOL)[1]
        real = chain(machine, errors, q, TOOL)[1]
        turns = []
        for a in (axis, "C"):
            turned = chain(machine, None, {**q, a: q[a] + 1e-6}, TOOL)[1]
            turns.append(np.cross(wanted, turned) / 1e-6)
        tilt[i] = np.cross(wanted, real)
        columns.append(np.stack(turns, axis=1))
    columns = np.array(columns)
    design = []
    for k in range(2):
        for a in machine.structure.axes:
            for j in range(len(NODES[a])):
                hat = np.interp(where[a], NODES[a], np.eye(7)[j])
                design.append((columns[:, :, k] * hat[:, None]).reshape(-1))
    design = np.array(design).T
    best = tilt.reshape(-1) - design @ np.linalg.lstsq(design, tilt.reshape(-1), rcond=1e-6)[0]
    at = Conditions.at(where, tool=TOOL)
    left = tilt.copy()
    for table in turning:
        k = (axis, "C").index(table.output.place)
        left -= columns[:, :, k] * table.value(at)[:, None]

    def rms(v):
        return float(np.sqrt((v**2).sum() / n))

    assert rms(left) < 0.8 * rms(tilt)
    assert rms(left) < 1.05 * rms(best)


@pytest.mark.parametrize("name", ["siemens-840d", "heidenhain-tnc"])
def test_the_files_of_a_controller_hold_them(name):
    """Tables whose output is a rotary axis, written and read again."""
    errors = separable()
    for axis in "XZBC":  # this control's tables are 0 where their axis is
        errors[axis][3:] -= [[np.interp(0.0, NODES[axis], e)] for e in errors[axis][3:]]
    machine, field = field_of("mixed", errors)
    controller = make_controller(name, machine, {})
    made = project(field, Volume.of(machine), controller.capability, orientation=True)
    read = controller.read(controller.write(controller.adapted(made.tables)))
    tables = [t.as_sign(Sign.ERROR) for t in read]
    assert {"E_BB(X)", "E_BB(Z)"} <= {t.name for t in tables}
    found = poses(machine, errors, tables)
    assert found[:, 0, 1].max() > 1e-4
    assert found[:, 1, 1].max() < 4e-6  # 200 points, between which the errors have their corners


def test_a_constant_that_the_tables_cannot_hold_is_reported_with_its_size():
    errors = {a: np.zeros((6, 7)) for a in machine_of(CODES["mixed"]).structure.axes}
    errors["X"][4] = 5e-5
    machine, field = field_of("mixed", errors)
    controller = make_controller("siemens-840d", machine, {})
    made = project(field, Volume.of(machine), controller.capability, orientation=True)
    (note,) = [n for n in made.notes if "constant turn" in n]
    assert note.startswith("B: ")
    assert "50.0 µrad" in note
    left = TrialPoints.over(field, Volume.of(machine)).remainder(made.tables)
    assert left.lean_rms == pytest.approx(5e-5, rel=1e-3)


def test_without_being_asked_for_a_table_holds_its_axis_own_error_only():
    errors = separable()
    machine, field = field_of("mixed", errors)
    tables = {t.name: t for t in project(field, Volume.of(machine), SINGLE).tables}
    assert not [n for n in tables if n.startswith(("E_BB(", "E_CC("))]
    at = np.linspace(-1.5, 1.5, 40)
    np.testing.assert_allclose(
        tables["E_BB"].at(at), np.interp(at, NODES["B"], errors["B"][4]), atol=1e-6
    )


def test_what_cannot_hold_a_direction_is_refused():
    machine, field = field_of("C table", errors_of(machine_of(CODES["C table"])))
    with pytest.raises(InputError, match="no rotary axis of this machine"):
        project(field, Volume.of(machine), SINGLE, orientation=True)
    machine, field = field_of("mixed", separable())
    with pytest.raises(InputError, match="no tables that correct a rotary axis"):
        project(field, Volume.of(machine), RIGID, orientation=True)


def test_an_axis_that_only_turns_the_tool_about_itself_holds_its_own_angle():
    errors = {a: np.zeros((6, 7)) for a in machine_of(CODES["C table"]).structure.axes}
    errors["C"][5] = np.linspace(-4e-5, 8e-5, 7)
    errors["X"][5] = 5e-5 * np.array([0, 1, 0, -1, 0, 1, 0])
    machine, field = field_of("C table", errors)
    tables = {t.name: t for t in project(field, Volume.of(machine), SINGLE).tables}
    assert not [n for n in tables if n.startswith("E_CC(")]
    at = np.linspace(-3.0, 3.0, 50)
    np.testing.assert_allclose(
        tables["E_CC"].at(at), np.interp(at, NODES["C"], errors["C"][5]), atol=1e-6
    )
    assert TrialPoints.over(field, Volume.of(machine)).remainder().lean_rms < 1e-9


def test_a_lean_that_no_axis_turns_back_is_told_with_its_size():
    errors = {a: np.zeros((6, 7)) for a in machine_of(CODES["C table"]).structure.axes}
    errors["X"][3] = 4e-5
    machine, field = field_of("C table", errors)
    made = project(field, Volume.of(machine), SINGLE)
    left = TrialPoints.over(field, Volume.of(machine)).remainder(made.tables)
    assert left.lean_rms == pytest.approx(4e-5, rel=1e-6)
    assert left.lean_largest == pytest.approx(4e-5, rel=1e-6)
