"""A worm's wave on a rotary axis, beside the wheel's run-out: named with its period in degrees."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.units import read_in
from benchmarks.hidden.judging.trial import as_campaign

STEP, TEETH = 3.7, 36
"""Degrees between the angles of a polygon or autocollimator; teeth of the wheel."""


def test_a_worm_and_its_wheel():
    model = parse_model(
        TomlSource("""
format = "abbe-model/1"
[machine]
name = "table"
structure = "w C' b X Y Z t"
axes.X.travel = [-400.0, 400.0]
axes.Y.travel = [-400.0, 400.0]
axes.Z.travel = [-300.0, 300.0]
axes.C.travel = [0.0, 360.0]
""")
    )
    rng = np.random.default_rng(1)
    rows = ['# format = "abbe-campaign/1"', "time,setup,kind,X,Y,Z,C,C_dir,ux,uy,uz,value"]
    for way in (1, -1):
        for angle in np.arange(0.0, 360.0, STEP)[::way]:
            at = np.deg2rad(angle)
            error = 20.0 * np.sin(TEETH * at + 0.4) + 30.0 * np.cos(at + 1.0)
            time, value = 5 * len(rows), error + rng.normal(0.0, 1.5)
            rows.append(f"{time},p,rotation,0,0,0,{angle:.6f},{way},0,0,1,{value:.3f}")
    found = diagnose(model, as_campaign("\n".join(rows) + "\n", model))
    specs = [e.found.candidate.effect.spec for e in found.established]
    assert specs == ["rotary_positioning axis=C harmonics=1", "cyclic axis=C"]
    effect = found.established[1].found.candidate.effect
    (period,) = effect.nonlinear(model.machine)
    unit, factor = read_in(period)
    values = {e.name: e.value for e in found.established[1].estimates}
    assert unit == "°"
    assert values["period"] * factor == pytest.approx(10.0, abs=0.005)
    assert np.hypot(values["A1"], values["B1"]) == pytest.approx(20e-6, abs=1e-6)


def test_three_turns_of_a_worm_are_not_taken_for_one_and_a_half() -> None:
    """A telescope follows the sky for half an hour: 7.5° of an axis that can turn around.

    How close waves may lie was taken from the whole turn and its few places, so that the worm's
    wave was found as the second harmonic of one twice as long.
    """
    model = parse_model(
        TomlSource(
            'format = "abbe-model/1"\n[machine]\nname = "mount"\nstructure = "w b C t"\n'
            "axes.C.travel = [-180.0, 180.0]\n"
        )
    )
    rng = np.random.default_rng(3)
    rows = [
        '# format = "abbe-campaign/1"\n# [setups.run]\n# free = ["zero", "slope"]',
        "time,setup,kind,C,ux,uy,uz,value",
    ]
    angles = np.linspace(-25.0, -17.5, 180) + rng.uniform(-0.01, 0.01, 180)
    for k, angle in enumerate(angles):
        turn = 2.0 * np.pi * angle / 2.5
        error = 40.0 * np.sin(turn + 0.7) + 10.0 * np.cos(2.0 * turn) + 6.0 * (angle + 21.0) ** 2
        rows.append(f"{10 * k},run,rotation,{angle:.5f},0,0,1,{error + rng.normal(0.0, 8.0):.2f}")
    found = diagnose(model, as_campaign("\n".join(rows) + "\n", model))
    (worm,) = (e for e in found.established if e.found.candidate.effect.kind == "cyclic")
    assert np.rad2deg(worm.found.screened.nonlinear["period"]) == pytest.approx(2.5, abs=0.05)


def test_a_harmonic_that_is_greater_than_the_wave_is_the_wave() -> None:
    free = make_effect("cyclic", {"axis": "X", "harmonics": 2})
    known = make_effect("cyclic", {"axis": "X", "harmonics": 2, "period": 10.0})
    much = {"A1": 1e-3, "B1": 0.0, "A2": 0.0, "B2": 3e-3}
    assert free.misnamed(much)
    assert not known.misnamed(much)
    assert not free.misnamed({**much, "B2": 1e-3})
