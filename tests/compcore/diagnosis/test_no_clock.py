"""A campaign that says no times: the order of its rows is no clock, and that is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.repeats import approach
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.campaign_notes import NO_CLOCK
from abbe.compcore.diagnosis.screening.candidates import candidates
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model, parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from abbe.daemon.application import app
from benchmarks.hidden.judging.trial import as_campaign
from tests.support.compcore.lathe_days import LATHE, lathe_days

OF_TIME = {"drift", "warm_up", "event", "instrument_drift"}


def plate(folder: Path, *, clock: bool) -> tuple[Path, Path]:
    """Holes of a plate in the order of drilling, with an oscillation in that order; 60 s each."""
    rng = np.random.default_rng(3)
    text = ['format = "abbe-model/1"', "[machine]", 'name = "mill"', 'structure = "w b X Y Z t"']
    text += [f"[machine.axes.{a}]\ntravel = [0.0, 400.0]" for a in "XYZ"]
    text += ['[machine.signals.T_air]\nunit = "degC"\nrole = "ambient"']
    rows = ['# format = "abbe-campaign/1"', '# instrument = "CMM"', "# [setups.plate]"]
    rows += ['# free = ["frame"]', "time," * clock + "setup,kind,X,Y,Z,ux,uy,uz,value,T_air"]
    places = [(x, y) for x in np.linspace(20, 380, 9) for y in np.linspace(20, 380, 9)]
    for i, (x, y) in enumerate(places):
        temperature = 20.0 + np.sin(i / 20.0) + rng.normal(0.0, 0.05)
        wave = 6.0 * np.sin(2.0 * np.pi * i / 7.3)
        error = np.array([50e-3 * y, 0.0]) + rng.normal(0.0, 0.5, 2) + wave
        for k in range(2):
            u = ("1,0,0", "0,1,0")[k]
            when = f"{60 * i}," * clock
            rows.append(f"{when}plate,displacement,{x},{y},0,{u},{error[k]:.3f},{temperature:.3f}")
    model, campaign = folder / "model.toml", folder / f"plate-{clock}.csv"
    model.write_text("\n".join(text))
    campaign.write_text("\n".join(rows) + "\n")
    return model, campaign


def _read(files: tuple[Path, Path]) -> tuple[Model, Campaign]:
    model = load_model(files[0])
    return model, read_campaign(files[1], model.machine)


def test_without_times_nothing_of_time_is_offered(tmp_path: Path) -> None:
    model, campaign = _read(plate(tmp_path, clock=False))
    assert not campaign.clocked
    tried = [c.effect for c in candidates(model, campaign)]
    assert {"squareness", "thermal_offset"} <= {e.kind for e in tried}
    assert not OF_TIME & {e.kind for e in tried}
    assert not [e.spec for e in tried if getattr(e, "tau", None) is not None]
    found = diagnose(model, campaign)
    assert "squareness axes=X,Y" in [e.effect.spec for e in found.established]
    assert all("t" not in s.depends_on for s in found.structure)
    assert NO_CLOCK in list(found.words())


def test_with_times_the_same_rows_do_oscillate(tmp_path: Path) -> None:
    model, campaign = _read(plate(tmp_path, clock=True))
    assert campaign.clocked
    assert {c.effect.kind for c in candidates(model, campaign)} >= OF_TIME
    found = diagnose(model, campaign)
    assert any("t" in s.depends_on for s in found.structure)
    assert NO_CLOCK not in list(found.words())


def test_the_command_says_it(tmp_path: Path) -> None:
    files = [str(f) for f in plate(tmp_path, clock=False)]
    said = CliRunner().invoke(app, ["diagnose", *files])
    assert NO_CLOCK in " ".join(said.stdout.split())
    answer = json.loads(CliRunner().invoke(app, ["diagnose", *files, "--json"]).stdout)
    assert answer["clock"] is False


def test_sides_of_approach_do_not_follow_from_the_order_of_rows(tmp_path: Path) -> None:
    _, timed = _read(plate(tmp_path, clock=True))
    _, untimed = _read(plate(tmp_path, clock=False))
    assert set(approach(timed, "Y")) == {-1, 1}
    assert set(approach(untimed, "Y")) == {0}


def test_without_a_clock_a_body_is_as_warm_as_its_signal() -> None:
    """Rows of one time alike are in equilibrium each; with a clock the first one's lag is told."""
    reading = np.array([20.0, 25.0, 22.0])
    still = Conditions({"X": np.zeros(3)}, signals={"T": reading})
    assert still.lag("T", 600.0) == pytest.approx(reading)
    timed = Conditions(
        {"X": np.zeros(3)}, time=np.array([0.0, 60.0, 120.0]), signals={"T": reading}
    )
    # τ·y' = T − y with T straight between samples: y(60) = 25 − 5·τ/60·(1 − e^(−60/τ))
    rise = 5.0 * (1.0 - 10.0 * (1.0 - np.exp(-0.1)))
    assert timed.lag("T", 600.0)[1] == pytest.approx(20.0 + rise)


def test_nights_without_readings_are_said() -> None:
    model = parse_model(TomlSource(LATHE))
    found = diagnose(model, as_campaign(lathe_days(1, alone=False), model))
    assert any("pauses over nights (5, 6 h or more)" in words for words in found.words())
