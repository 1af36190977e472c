"""``abbe correct`` and ``abbe table`` of a model with compensations that are off or only shown."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from abbe.compcore.effects import ScaleExpansion, Straightness
from abbe.compcore.files.model_file import save_model
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from tests.support.daemon.command_line import abbe

GROWS = "scale_expansion axis=X signals=T"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    axes = {a: Axis(a, (0.0, 500.0)) for a in "XYZ"}
    machine = Machine("m", Structure.parse("w b Y X Z t"), axes, {"T": Signal("T")})
    grows = Term(ScaleExpansion(axis="X", signals=("T",)), {"alpha": Value(1e-5)}, "shown")
    bends = Term(Straightness(axis="X", direction="Y", shape="constant"), {"value": Value(3e-3)})
    off = Term(
        Straightness(axis="X", direction="Z", shape="constant"), {"value": Value(9e-3)}, "off"
    )
    path = tmp_path / "model.toml"
    save_model(Model(machine, (grows, bends, off)), path)
    return path


def test_a_point_is_corrected_by_what_is_on(model: Path) -> None:
    done = abbe("correct", model, "X=200", "Y=1", "Z=2", "T=25", "--json")
    assert done.status == 0, done.err
    answer = json.loads(done.out)
    assert answer["correction"] == pytest.approx({"X": 0.0, "Y": 3e-3, "Z": 0.0})
    assert answer["shown"] == {GROWS: pytest.approx({"X": 200.0 * 1e-5 * 5.0, "Y": 0.0, "Z": 0.0})}
    assert len(answer["off"]) == 1
    assert "direction=Z" in answer["off"][0]
    assert f"{GROWS} is only shown and not applied: X +10.00, Y +0.00, Z +0.00 µm" in done.err
    assert "is off and not applied" in done.err


def test_what_is_not_applied_asks_for_no_temperature(model: Path) -> None:
    done = abbe("correct", model, "X=200", "Y=1", "Z=2")
    assert done.status == 0, done.err
    assert "a signal that it reads is not stated" in done.err


def test_a_file_is_corrected_by_what_is_on(model: Path, tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text("X,Y,Z\n200,1,2\n")
    done = abbe("correct", model, "--points", tmp_path / "in.csv", "-o", tmp_path / "out.csv")
    assert done.status == 0, done.err
    assert "200.0000000,1.0030000,2.0000000" in (tmp_path / "out.csv").read_text()
    assert "is only shown and not applied" in done.err


def test_tables_hold_what_is_on(model: Path, tmp_path: Path) -> None:
    done = abbe("table", model, "--controller", "linuxcnc", "-o", tmp_path / "t", "--json")
    assert done.status == 0, done.err
    answer = json.loads(done.out)
    assert any("only shown and not applied" in note for note in answer["notes"])
    assert answer["remaining"]["no compensation"]["max"] == pytest.approx(0.0, abs=1e-6)
