"""Tables of machines without one of X, Y, Z: no table is made for an axis that is not there."""

from __future__ import annotations

import re

import numpy as np
import pytest

from abbe.compcore.effects import Positioning, Straightness
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.tables.of_model import project_tables
from abbe.drivers.controllers import make_controller

KINDS = [
    ("siemens-840d", {}),
    ("siemens-840d", {"products": "mirrored"}),
    ("heidenhain-tnc", {}),
    ("twincat-isg", {"form": "axes"}),
    ("csv", {"holds": "moves"}),
]
TRAVEL = {"X": (0.0, 200.0), "Y": (0.0, 100.0), "Z": (-400.0, 0.0)}


def machine(code: str) -> Model:
    """Every axis with an error of its own, and moving what it carries aside both ways."""
    structure = Structure.parse(code)
    found = Machine("few", structure, {a: Axis(a, TRAVEL[a]) for a in structure.linear})
    terms = []
    for axis in structure.linear:
        for effect in (
            Positioning(axis=axis, shape="polynomial:2"),
            *(
                Straightness(axis=axis, direction=d, shape="polynomial:2")
                for d in "XYZ"
                if d != axis
            ),
        ):
            values = {p.name: Value(0.004) for p in effect.linear(found)}
            terms.append(Term(effect, values))
    return Model(found, tuple(terms))


@pytest.mark.parametrize("code", ["w (C') b Z X t", "w Y' b t"])
@pytest.mark.parametrize(("dialect", "options"), KINDS)
def test_no_table_for_an_axis_that_is_not_there(dialect, options, code) -> None:
    model = machine(code)
    controller = make_controller(dialect, model.machine, options)
    tables = project_tables(model, controller.capability).tables
    there = model.machine.structure.carrying
    assert {(t.inputs[0], t.output.component) for t in tables} == {
        (a, b) for a in there for b in there
    }
    files = controller.write(tables)
    missing = "".join(a for a in "XYZ" if a not in there)
    text = "\n".join(files.values())
    assert not re.search(rf"\b(E_)?[{missing}](1|{'|'.join(there)})\b", text)
    read = {t.name: t for t in controller.read(files)}
    for table in tables:
        where = np.linspace(*TRAVEL[table.inputs[0]], 7)
        assert read[table.name].at(where) == pytest.approx(table.at(where), abs=2e-4)
