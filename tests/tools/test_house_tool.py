"""The house has no circles and nothing upwards; the tool that says so, on houses that are known."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from tools.house import HOUSES, circles, described, house, imports

ROOT = Path(__file__).parents[2]


@cache
def real() -> dict[str, frozenset[str]]:
    return imports(ROOT)


def built(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return root


def test_no_files_import_each_other_in_a_circle():
    assert circles(real()) == []


@pytest.mark.parametrize("name", HOUSES)
def test_no_rooms_import_each_other_in_a_circle(name: str):
    found = house(name, real())
    assert len(found.arrows) > 10
    assert found.count > 40
    assert found.circles == ()
    assert found.upwards == ()


def test_every_room_stands_above_those_that_it_imports():
    for name in HOUSES:
        found = house(name, real())
        for room, below in found.arrows.items():
            assert found.floors[room] == 1 + max((found.floors[b] for b in below), default=0)


HOUSE = {
    "compcore/__init__.py": "",
    "compcore/errors.py": "import math\n",
    "compcore/model/__init__.py": "from abbe.compcore.model.model import Model\n",
    "compcore/model/model.py": "from abbe.compcore.errors import InputError\n",
    "compcore/fitting/__init__.py": "",
    "compcore/fitting/fit.py": "from abbe.compcore.model import Model\nfrom . import weights\n",
    "compcore/fitting/weights.py": "from ..errors import InputError\n",
}


def test_rooms_floors_and_arrows(tmp_path: Path):
    found = house("compcore", imports(built(tmp_path, HOUSE)))
    assert found.arrows == {"errors": set(), "fitting": {"errors", "model"}, "model": {"errors"}}
    assert found.floors == {"errors": 1, "model": 2, "fitting": 3}
    assert found.count == 3
    assert found.circles == found.upwards == ()


def test_files_are_found_by_whatever_import(tmp_path: Path):
    found = imports(built(tmp_path, HOUSE))
    assert found["compcore.fitting.fit"] == {"compcore.model", "compcore.fitting.weights"}
    assert found["compcore.fitting.weights"] == {"compcore.errors"}
    assert found["compcore.model"] == {"compcore.model.model"}


@pytest.mark.parametrize(
    "text",
    [
        "from abbe.compcore.fitting.fit import fit\n",
        "import abbe.compcore.fitting.fit\n",
        "from abbe.compcore.fitting import fit\n",
        "def late():\n    from abbe.compcore.fitting.fit import fit\n",
        "if TYPE_CHECKING:\n    from abbe.compcore.fitting.fit import fit\n",
    ],
)
def test_a_circle_is_found_wherever_the_import_stands(tmp_path: Path, text: str):
    root = built(tmp_path, HOUSE | {"compcore/model/model.py": text})
    assert circles(imports(root)) == [
        ("compcore.fitting.fit", "compcore.model", "compcore.model.model")
    ]
    found = house("compcore", imports(root))
    assert found.circles == (("fitting", "model"),)
    assert found.upwards == (("fitting", "model"), ("model", "fitting"))
    assert found.floors == {"errors": 1, "fitting": 2, "model": 2}
    words = described(root)
    assert "compcore: 3 rooms on 2 floors, 3 arrows, 2 upwards, 1 circles of rooms" in words
    assert "1 circles of files" in words
