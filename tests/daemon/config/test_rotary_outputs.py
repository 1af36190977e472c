"""Configurations that correct rotary axes: units, limits, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import save_model
from abbe.daemon.answers.overview import overview
from abbe.daemon.config import load_config
from tests.integration.runs.test_live_five_axis import config_text
from tests.support.compcore.five_axis import CODES, errors_of, machine_of, model_of
from tests.support.daemon.command_line import abbe

MACHINE = machine_of(CODES["mixed"])
TEXT = config_text(MACHINE.structure.axes, 502)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    save_model(model_of(MACHINE, errors_of(MACHINE)), tmp_path / "model.toml")
    return tmp_path / "config.toml"


def test_degrees_at_the_edge_radians_inside(config: Path) -> None:
    config.write_text(TEXT.replace("max_turn = 0.2", "max_turn = { B = 0.1, C = 0.2 }"))
    found = load_config(config)
    assert found.limits.turning == ("C", "B")  # as the structure has them
    assert found.limits.max_turn == pytest.approx((math.radians(0.2), math.radians(0.1)))
    assert found.limits.max_turn_rate == pytest.approx(math.radians(5.0))
    assert found.limits.directions == ("X", "Y", "Z", "C", "B")
    shown = overview(found)
    assert shown["guard"]["max_turn_deg"] == {"C": 0.2, "B": 0.1}
    (row,) = [r for r in shown["outputs"] if r["what"] == "corrected C"]
    assert (row["from"], row["unit"]) == ("rad", "deg")


def test_check_says_it(config: Path) -> None:
    config.write_text(TEXT)
    done = abbe("check", config)
    assert done.status == 0, done.err
    assert "Rotary axes turned by at most C 0.2, B 0.2 degrees" in done.out


@pytest.mark.parametrize(
    ("old", "new", "field", "words"),
    [
        ("max_turn = 0.2\n", "", "guard.max_turn", "by how much at most"),
        ("max_turn = 0.2\n", "max_turn = { C = 0.1 }\n", "guard.max_turn", "B is corrected"),
        (
            "max_turn = 0.2\n",
            "max_turn = { A = 0.1, B = 0.1, C = 0.1 }\n",
            "guard.max_turn.A",
            "no rotary axis of that name",
        ),
        ("max_turn_rate = 5.0\n", "", "guard.max_turn_rate", "how fast"),
        (
            "max_turn_rate = 5.0",
            "max_turn_rate = 0.1",
            "guard.max_turn_rate",
            "at least 0.666667 deg/s",
        ),
        (
            '[output.axes.Y]\ntarget = "nc.to_Y"\n',
            "",
            "output.axes.C",
            "nothing takes that back in Y",
        ),
        (
            'address = 4, type = "float64", unit = "mm", writable',
            'address = 4, type = "float64", unit = "deg", writable',
            "output.axes.Y",
            "in deg, and mm is needed",
        ),
        (
            'address = 8, type = "float64", unit = "deg", writable',
            'address = 8, type = "float64", unit = "mm", writable',
            "output.axes.C",
            "in mm, and rad or deg is needed",
        ),
        (
            'address = 8, type = "float64", unit = "deg", writable',
            'address = 8, type = "int32", scale = 1e-8, unit = "deg", writable',
            "output.axes.C.target",
            "cannot hold",
        ),
    ],
)
def test_what_cannot_work_is_refused(
    config: Path, old: str, new: str, field: str, words: str
) -> None:
    assert old in TEXT
    config.write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=words) as caught:
        load_config(config)
    assert caught.value.field == field
