"""Every dialect's files, to the letter: checked by eye against the makers' documentation."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.drivers.controllers import controller_kinds, make_controller
from tests.support.drivers.controllers.cases import CASES, machine

FOLDER = Path(__file__).parents[2] / "data" / "controllers"
IDS = [case.folder for case in CASES]


@pytest.mark.parametrize("case", CASES, ids=IDS)
def test_written_to_the_letter(case):
    controller = make_controller(case.controller, machine(case.code), case.options)
    written = controller.write(controller.adapted(case.made()))
    folder = FOLDER / case.folder
    assert set(written) == {p.name for p in folder.iterdir()}
    for name, text in written.items():
        assert text == (folder / name).read_bytes().decode("utf-8"), name


@pytest.mark.parametrize("case", CASES, ids=IDS)
def test_read_back_what_was_to_be_written(case):
    controller = make_controller(case.controller, machine(case.code), case.options)
    texts = {
        p.name: p.read_bytes().decode("utf-8") for p in sorted((FOLDER / case.folder).iterdir())
    }
    found = controller.read(texts)
    for table in controller.adapted(case.made()):
        (mine,) = [t for t in found if t.same_number(table)]
        assert mine.difference(table) < 1e-11, table.name
        assert mine.directional == table.directional


def test_every_dialect_has_a_golden_file():
    assert {case.controller for case in CASES} == set(controller_kinds())
    assert {p.name for p in FOLDER.iterdir()} == set(IDS)
