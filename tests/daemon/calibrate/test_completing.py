"""Completing a model in a calibration: waves that the campaign cannot tell are not added."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from abbe.compcore.diagnosis.screening.parameters import Estimate
from abbe.compcore.effects import Backlash, Cyclic, Positioning
from abbe.compcore.effects.base import Effect
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.daemon.commands.calibration import diagnosing
from tests.support.daemon.command_line import abbe

STEP = 20.0
SHORT, LONG = Cyclic(axis="X", period=4.8), Cyclic(axis="X", period=60.0)
PLAY = Backlash(axis="X")
UNSURE: dict[str, float] = {}
"""Spec → standard uncertainty of its values, mm."""
DOUBTED: dict[str, bool] = {}
"""Specs whose values no sound machine shows."""
ABSURD = (Estimate("hysteresis", "mm", 3.0, 0.01, False, (-0.2, 0.2), "lost motion"),)


def save(path: Path, *effects: Effect, sd: float | None = None) -> None:
    """A model with these effects, their values all 1 µm, with the standard uncertainty `sd`."""
    machine = Machine(
        "mill", Structure.parse("w b X Y Z t"), {a: Axis(a, (0.0, 400.0)) for a in "XYZ"}
    )
    terms = [Term(e, {p.name: Value(1e-3, sd) for p in e.linear(machine)}) for e in effects]
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
        left = [
            SimpleNamespace(effect=e, estimates=ABSURD if e.spec in DOUBTED else ())
            for e in causes
            if e.spec not in has
        ]
        return SimpleNamespace(established=tuple(left), strays=())

    def add(model: Path, spec: str, _: Path, out: Path, *, robust: bool) -> list[str]:
        assert not robust
        chosen = [e for e in causes if e.spec == spec]
        sd = UNSURE.get(spec)
        save(out, *load_model(model).effects, *chosen, sd=sd)
        return [f"written: {spec}"]

    monkeypatch.setattr(diagnosing, "diagnose", diagnose)
    monkeypatch.setattr(diagnosing, "diagnosis_words", lambda *_: ())
    monkeypatch.setattr(diagnosing, "said_in_the_shop", lambda *_: "It errs")
    monkeypatch.setattr(diagnosing, "gain_of", lambda *_: "")
    monkeypatch.setattr(diagnosing, "add", add)
    return causes


def complete(folder: Path, says_yes_to: str | None = "") -> tuple[set[str], str]:
    """The effects that were added, and what was said; `says_yes_to` None: nobody is there."""
    said: list[str] = []

    def ask(question: str, *, default: bool = True) -> bool:
        return default if says_yes_to is None else says_yes_to in question

    left_out = diagnosing.complete_model(
        folder / "fitted.toml", folder / "c.csv", folder / "out.toml", said.append,
        ask,
    )  # fmt: skip
    specs = {e.spec for e in load_model(folder / "out.toml").effects}
    said.append(left_out)
    return specs - {"positioning axis=X shape=polynomial:1"}, "\n".join(said)


def test_a_wave_that_even_steps_cannot_tell_is_not_added(
    tmp_path: Path, found: list[Effect]
) -> None:
    found += [SHORT, PLAY]
    added, said = complete(tmp_path)
    assert added == {PLAY.spec}
    assert f"{SHORT.spec} is not added: X was read every 20 mm" in said
    assert {p.name for p in tmp_path.glob("fitted-*")} == {"fitted-2.toml"}
    # nobody is told of a file that is gone
    assert f"written: {SHORT.spec}" not in said
    assert f"written: {PLAY.spec}" in said


def test_a_wave_that_they_tell_is_added(tmp_path: Path, found: list[Effect]) -> None:
    found += [LONG, PLAY]
    assert complete(tmp_path)[0] == {LONG.spec, PLAY.spec}


def test_what_a_person_does_not_want_is_not_added_and_the_next_is_asked_for(
    tmp_path: Path, found: list[Effect]
) -> None:
    found += [LONG, PLAY]
    assert complete(tmp_path, says_yes_to="backlash")[0] == {PLAY.spec}


@pytest.mark.parametrize(("says_yes_to", "is_added"), [(None, False), ("", True), ("cyc", False)])
def test_what_no_sound_machine_shows_is_added_only_by_somebody_who_says_yes(
    tmp_path: Path,
    found: list[Effect],
    monkeypatch: pytest.MonkeyPatch,
    says_yes_to: str | None,
    *,
    is_added: bool,
) -> None:
    """Nobody there, somebody who says yes, somebody who says no: it is asked for once."""
    found += [PLAY, LONG]
    monkeypatch.setitem(DOUBTED, PLAY.spec, True)
    added, said = complete(tmp_path, says_yes_to)
    assert added == ({PLAY.spec, LONG.spec} if is_added else {LONG.spec})
    assert said.count(f"{PLAY.spec} is not added: hysteresis lies") == (not is_added)
    assert (f"established, and left out: {PLAY.spec}; hysteresis" in said) is not is_added


@pytest.mark.parametrize(("sd", "is_added"), [(0.6e-3, False), (0.4e-3, True)])
def test_a_cause_whose_values_are_below_twice_their_uncertainty_is_left_out(
    tmp_path: Path,
    found: list[Effect],
    monkeypatch: pytest.MonkeyPatch,
    sd: float,
    *,
    is_added: bool,
) -> None:
    found += [LONG, PLAY]
    monkeypatch.setitem(UNSURE, LONG.spec, sd)
    added, said = complete(tmp_path)
    assert added == ({LONG.spec, PLAY.spec} if is_added else {PLAY.spec})
    assert (f"{LONG.spec} is not added: none of its values" in said) is not is_added


def test_a_model_that_lacks_nothing_is_fitted_again_without_what_stands_alone(
    tmp_path: Path,
) -> None:
    """The real diagnosis and fit: one reading of 40 was mistyped; the scale is as without it."""
    base = Positioning(axis="X", shape="polynomial:1")
    save(tmp_path / "start.toml", base)
    rng = np.random.default_rng(3)
    rows = ["# [setups.line]", '# free = ["zero"]', "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd"]
    places = np.tile(np.arange(10.0, 400.0, STEP), 4)
    for i, x in enumerate(places):
        value = 0.05 * x + rng.normal(0.0, 0.3) + (60.0 if i == 58 else 0.0)
        rows.append(f"{5 * i},line,displacement,{x},200,200,1,1,0,0,{value:.3f},0.3")
    head = '# format = "abbe-campaign/1"\n'
    (tmp_path / "c.csv").write_text(head + "\n".join(rows) + "\n", encoding="utf-8")
    done = abbe("fit", tmp_path / "start.toml", tmp_path / "c.csv", "-o", tmp_path / "fitted.toml")
    assert done.status == 0, done.err

    def error_at_end(path: Path) -> float:
        model = load_model(path)
        at = [model.predict(Conditions.at({"X": x, "Y": 200.0, "Z": 200.0})) for x in (10.0, 390.0)]
        ends = [float(p.translation[0, 0]) for p in at]
        return 1e3 * (ends[1] - ends[0])

    assert abs(error_at_end(tmp_path / "fitted.toml") - 19.0) > 1.0  # the mistyped one counts
    added, said = complete(tmp_path)
    assert added == set()
    assert "without what stands alone" in said
    assert error_at_end(tmp_path / "out.toml") == pytest.approx(19.0, abs=0.3)
