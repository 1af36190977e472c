"""Heidenhain TNC: the makers' own examples, and the chain of KinematicsComp against rigid bodies.

What the rows of kinematics.tab do is reckoned here by 4 × 4 matrices written out row by row, from
the tool outwards, and compared with the machine's exact error: no formula is shared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, first_order
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.tables.table import tables_of
from abbe.drivers.controllers import make_controller
from abbe.drivers.controllers.heidenhain.text import nc_table, read_nc_table
from tests.support.drivers.controllers.cases import KINEMATICS, TNC, machine, motions

DEGREE = np.pi / 180.0


def test_the_rows_of_the_manual():
    """iTNC 530 HSCI Technical Manual, p. 684: the error motions of X before MachAxis X."""
    files = make_controller("heidenhain-tnc", machine(), {"form": "kinematics"}).write(KINEMATICS)
    lines = files["kinematics.tab"].splitlines()
    at = next(i for i, line in enumerate(lines) if "EYX" in line)
    assert [line.split()[1:] for line in lines[at : at + 6]] == [
        ["EYX", "Trans", "Y", "A..C2"],
        ["EZX", "Trans", "Z", "A..C3"],
        ["EAX", "Trans", "A", "A..C4"],
        ["EBX", "Trans", "B", "A..C5"],
        ["ECX", "Trans", "C", "A..C6"],
        ["MachAxis", "X"],
    ]
    assert lines[-1] == "[END]"


def test_the_assignment_of_the_manual():
    """MANUALplus 620 p. 718: [axis in a COM's column] = F(axis in the CMA's column)."""
    files = make_controller("heidenhain-tnc", machine()).write(TNC)
    table = read_nc_table("config.cma", files["config.cma"])
    assert table.names == ("NR", "ACTIVE", "Y", "Z")
    assert [table.column(c)[0] for c in table.names] == ["0", "*", "y.com", "z.com"]
    # sag Z = F(Y): the column Z of Y's table
    assert "Z" in read_nc_table("y.com", files["y.com"]).names
    assert "BACKLASH" not in read_nc_table("z.com", files["z.com"]).names


def test_a_cell_without_an_entry_lies_between_its_neighbours():
    """TNC 306 Technical Manual, p. 121: points 3 and 4 of Y = F(Z) have no entry."""
    where = tuple(f"{-990 + 16.384 * i:.3f}" for i in range(9))
    values = ("0", "-0.06", "-0.09", "", "", "-0.12", "-0.12", "-0.1", "-0.09")
    files = {
        "config.cma": nc_table("config.cma", {"ACTIVE": ("*",), "Z": ("z.com",)}),
        "z.com": nc_table("z.com", {"AXISPOS": where, "Y": values}, unit=True),
    }
    (table,) = make_controller("heidenhain-tnc", machine()).read(files)
    assert table.name == "E_YZ"
    np.testing.assert_allclose(
        table.forward, [0, -0.06, -0.09, -0.10, -0.11, -0.12, -0.12, -0.1, -0.09], atol=1e-12
    )


# ------------------------------------------------- the chain, by matrices from the tool outwards


def turn(letter: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"A": (1, 2), "B": (2, 0), "C": (0, 1)}[letter]
    out = np.eye(4)
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


def shift(letter: str, by: float) -> np.ndarray:
    out = np.eye(4)
    out["XYZ".index(letter), 3] = by
    return out


def from_workpiece(rows, files, position, tool, *, errors: bool) -> np.ndarray:
    """Where the tool's tip is, seen from the workpiece, by the control's rows.

    A row further down is nearer to the workpiece. A nominal Trans is the way from the frame before
    it, so the frame before stands at its negative; MachAxis moves what is before it; an error
    motion moves what is before it by what its column says at the axis's position.
    """
    where = np.eye(4)
    for r in range(3):
        where[r, 3] = tool[r]
    read = {f: read_nc_table(f, text) for f, text in files.items()}
    for i, key in enumerate(rows.column("KEY")):
        axis, coord = rows.column("AXIS")[i], rows.column("COORD")[i]
        doc = rows.column("DOC")[i]
        if key == "MachBase":
            continue
        if key == "MachAxis":
            move = turn(axis, position[axis]) if axis in "ABC" else shift(axis, position[axis])
        elif doc:
            if not errors:
                continue
            of = doc[-1]
            table = read[f"{of.lower()}.com"]
            column = rows.column("COMPTAB")[i].partition("..")[2]
            scale = DEGREE if axis in "ABC" else 1.0
            unit = DEGREE if of in "ABC" else 1.0
            value = scale * np.interp(
                position[of], unit * table.numbers("AXISPOS"), table.numbers(column)
            )
            move = turn(axis, value) if axis in "ABC" else shift(axis, value)
        else:
            move = shift(axis, -float(coord))
        where = move @ where
    return where[:3, 3]


CODES = ["w b Y X Z t", "w X' b Y Z t", "w Z' Y' b X t", "w C' b X Y Z t", "w Y' b X Z B t",
         "w C' A' Y' b X Z t"]  # fmt: skip


@pytest.mark.parametrize("code", CODES)
def test_rows_put_every_error_motion_where_the_machine_has_it(code):
    rng = np.random.default_rng(5)
    structure = Structure.parse(code)
    axes = {}
    for name in structure.axes:
        rotary = name in "ABC"
        axes[name] = Axis(
            name,
            (-90 * DEGREE, 90 * DEGREE) if rotary else (-100.0, 200.0),
            location=(120.0, -40.0, 60.0) if rotary else (0.0, 0.0, 0.0),
            rotation_point=(0.0, 0.0, 0.0) if rotary else (0.0, 30.0, -100.0),
        )
    mill = Machine("", structure, axes)
    tables = []
    for name in structure.axes:
        where = [-90 * DEGREE, 0.0, 90 * DEGREE] if name in "ABC" else [-100.0, 50.0, 200.0]
        sizes = np.array([0.01] * 3 + [5e-5] * 3)
        tables += motions(name, where, rng.uniform(-1.0, 1.0, (3, 6)) * sizes)
    # the axis's own error is a move of the axis itself, in a column of its own
    kept = [t for t in tables if t.output.component != t.inputs[0]]
    controller = make_controller("heidenhain-tnc", mill, {"form": "kinematics", "decimals": "6",
                                                          "angle_decimals": "8"})  # fmt: skip
    steps = [_in_steps(t, 1e-8 * DEGREE if t.output.rotation else 1e-6) for t in kept]
    files = controller.write(steps)
    rows = read_nc_table("kinematics.tab", files.pop("kinematics.tab"))
    files.pop("config.cma")
    tool = np.array([5.0, -3.0, -80.0])
    for _ in range(5):
        position = {a: rng.uniform(*axes[a].travel) for a in axes}
        true = from_workpiece(rows, files, position, tool, errors=True)
        nominal = from_workpiece(rows, files, position, tool, errors=False)
        conditions = Conditions({a: np.array([q]) for a, q in position.items()}, tool=tool[None])
        chain = Chain(mill, conditions)
        np.testing.assert_allclose(nominal, chain.point[0], atol=1e-9)
        values = {
            t.output: t.at(np.array([position[t.inputs[0]]]))
            for a in structure.axes for t in tables_of(steps, a)
        }  # fmt: skip
        error, _ = first_order(chain, values)
        # second order: products of angles with levers and angles of others, 0.05 mrad × 0.02 mm
        np.testing.assert_allclose(true - nominal, chain.to_workpiece(error)[0], atol=2e-5)


def _in_steps(table, step):
    return replace(table, forward=np.rint(table.forward / step) * step)


def test_an_axis_that_lies_askew_has_no_row():
    structure = Structure.parse("w b X Y Z B t")
    axes = {a: Axis(a, (0.0, 100.0)) for a in "XYZ"}
    askew = Axis("B", (0.0, 1.0), direction=(0.0, np.sqrt(0.5), np.sqrt(0.5)))
    controller = make_controller(
        "heidenhain-tnc", Machine("", structure, {**axes, "B": askew}), {"form": "kinematics"}
    )
    with pytest.raises(InputError, match="askew"):
        controller.write(motions("X", [0, 100], [[0] * 6, [0, 1e-3, 0, 0, 0, 0]]))


@pytest.mark.parametrize("reference", ["C2", "A..{col}", "{column", "A ..{column}"])
def test_a_reference_that_names_no_column_is_refused(reference):
    with pytest.raises(InputError, match="column"):
        make_controller("heidenhain-tnc", machine(), {"reference": reference})
