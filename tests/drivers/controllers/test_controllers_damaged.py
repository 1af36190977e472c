"""Whatever happens to a controller's file, it is read or refused in a line; never anything else."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.errors import AbbeError
from abbe.drivers.controllers import make_controller
from tests.support.drivers.controllers.cases import CASES, machine

FOLDER = Path(__file__).parents[2] / "data" / "controllers"
SIGNS = "0123456789.-,[]=$%*:#;AEXYZ\n\t "
TRIES = 150


def damaged(text: str, rng: random.Random) -> str:
    """One to three characters altered, lost or put in, or a piece of the text lost or doubled."""
    signs = list(text)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(signs))
        match rng.randrange(6):
            case 0 | 1:
                signs[at] = rng.choice(SIGNS)
            case 2:
                del signs[at]
            case 3:
                signs.insert(at, rng.choice(SIGNS))
            case 4:
                del signs[at : at + rng.randint(2, 60)]
            case _:
                signs[at:at] = signs[at : at + rng.randint(2, 60)]
        if not signs:
            break
    return "".join(signs)


@pytest.mark.parametrize("case", CASES, ids=[case.folder for case in CASES])
def test_a_damaged_file_is_read_or_refused(case):
    controller = make_controller(case.controller, machine(case.code), case.options)
    rng = random.Random(case.folder)
    refused = 0
    for path in sorted((FOLDER / case.folder).iterdir()):
        text = path.read_bytes().decode("utf-8")
        for _ in range(TRIES):
            changed = damaged(text, rng)
            try:
                tables = controller.read({path.name: changed})
            except AbbeError:
                refused += 1
            else:
                assert all(np.isfinite(t.forward).all() for t in tables)
    assert refused > 10
