"""Completing a model in a calibration: waves that the campaign cannot tell are not added."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from abbe.compcore.effects import Backlash, Cyclic, Positioning
from abbe.compcore.effects.base import Effect
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.daemon.commands.calibration import diagnosing

STEP = 20.0
SHORT, LONG = Cyclic(axis="X", period=4.8), Cyclic(axis="X", period=60.0)
PLAY = Backlash(axis="X")


def save(path: Path, *effects: Effect) -> None:
    """A model with these effects, their values all 1 µm."""
    machine = Machine(
        "mill", Structure.parse("w b X Y Z t"), {a: Axis(a, (0.0, 400.0)) for a in "XYZ"}
    )
    terms = [Term(e, {p.name: Value(1e-3) for p in e.linear(machine)}) for e in effects]
    save_model(Model(machine, tuple(terms)), path)


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Effect]:
    """A fitted model, a line along X at even steps, and a diagnosis that finds what is put in."""
    base = Positioning(axis="X", shape="polynomial:1")
    save(tmp_path / "fitted.toml", base)
    rows = ["# [setups.line]", '# free = ["zero"]', "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value"]
    for i, x in enumerate(np.arange(10.0, 400.0, STEP)):
        rows.append(f"{5 * i},line,displacement,{x},200,200,1,1,0,0,0.0")
    (tmp_path / "c.csv").write_text(
        '# format = "abbe-campaign/1"\n' + "\n".join(rows) + "\n", encoding="utf-8"
    )
    causes: list[Effect] = []

    def diagnose(model: Model, *_: object, **__: object) -> SimpleNamespace:
        has = {e.spec for e in model.effects}
        left = [SimpleNamespace(effect=e) for e in causes if e.spec not in has]
        return SimpleNamespace(established=tuple(left), strays=())

    def add(model: Path, spec: str, _: list[Path], out: Path, *, robust: bool) -> None:
        assert not robust
        chosen = [e for e in causes if e.spec == spec]
        save(out, *load_model(model).effects, *chosen)

    monkeypatch.setattr(diagnosing, "diagnose", diagnose)
    monkeypatch.setattr(diagnosing, "diagnosis_words", lambda *_: ())
    monkeypatch.setattr(diagnosing, "add", add)
    return causes


def complete(folder: Path, says_yes_to: str = "") -> tuple[set[str], str]:
    """The effects that were added, and what was said."""
    said: list[str] = []
    diagnosing.complete_model(
        folder / "fitted.toml", folder / "c.csv", folder / "out.toml", said.append,
        lambda question: says_yes_to in question,
    )  # fmt: skip
    specs = {e.spec for e in load_model(folder / "out.toml").effects}
    return specs - {"positioning axis=X shape=polynomial:1"}, "\n".join(said)


def test_a_wave_that_even_steps_cannot_tell_is_not_added(
    tmp_path: Path, found: list[Effect]
) -> None:
    found += [SHORT, PLAY]
    added, said = complete(tmp_path)
    assert added == {PLAY.spec}
    assert f"{SHORT.spec} is not added: X was read every 20 mm" in said
    assert {p.name for p in tmp_path.glob("fitted-*")} == {"fitted-2.toml"}


def test_a_wave_that_they_tell_is_added(tmp_path: Path, found: list[Effect]) -> None:
    found += [LONG, PLAY]
    assert complete(tmp_path)[0] == {LONG.spec, PLAY.spec}


def test_what_a_person_does_not_want_is_not_added_and_the_next_is_asked_for(
    tmp_path: Path, found: list[Effect]
) -> None:
    found += [LONG, PLAY]
    assert complete(tmp_path, says_yes_to="backlash")[0] == {PLAY.spec}
