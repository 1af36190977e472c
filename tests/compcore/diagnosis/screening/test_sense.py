"""Candidates that make sense: no laser's causes without a laser, one cause one candidate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.screening.candidates import OF_A_LASER, candidates
from abbe.compcore.diagnosis.screening.parameters import Estimate, doubt_of, least_norm
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model, parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Signal
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

DATA = Path(__file__).parents[3] / "data" / "p02-bridge"


@pytest.fixture(scope="module")
def bridge() -> tuple[Model, Campaign]:
    model = load_model(DATA / "model.toml")
    return model, read_campaign(DATA / "fit.csv", model.machine)


@pytest.mark.parametrize(
    ("instrument", "expected"),
    [("laser interferometer", True), ("Interferometer", True), ("touch probe and plate", False)],
)
def test_a_laser_is_blamed_only_where_one_is_stated(
    bridge: tuple[Model, Campaign], instrument: str, expected: bool
) -> None:
    model, campaign = bridge
    stated = replace(campaign, metadata=({"instrument": instrument},))
    kinds = {c.effect.kind for c in candidates(model, stated)}
    assert bool(kinds & set(OF_A_LASER)) is expected


@pytest.mark.parametrize(
    ("head", "column", "expected"),
    [
        ({}, "p", True),
        ({}, "T", False),
        ({"instrument": "touch probe"}, "p", False),
    ],
)
def test_the_pressure_of_the_air_is_recorded_for_a_laser(
    head: dict[str, str], column: str, *, expected: bool
) -> None:
    """Where no instrument is named; warm air may be for anything, and a probe needs no pressure."""
    model, campaign = line(3, "0.0 * x")
    unit = {"p": "hPa", "T": "degC"}[column]
    machine = replace(model.machine, signals={column: Signal(column, unit, role="air")})
    seen = replace(campaign.conditions, signals={column: np.linspace(20.0, 22.0, campaign.n)})
    alone = replace(campaign, metadata=(head,), conditions=seen)
    kinds = {c.effect.kind for c in candidates(replace(model, machine=machine), alone)}
    assert ("air_refraction" in kinds) is expected


def line(seed: int, error: str) -> tuple[Model, Campaign]:
    """One laser line there and back, twice, on a machine without effects; the error in mm."""
    rng = np.random.default_rng(seed)
    text = ['format = "abbe-model/1"', "[machine]", 'name = "axis"', 'structure = "w b X Y Z t"']
    text += [f"[machine.axes.{a}]\ntravel = [0.0, 400.0]" for a in "XYZ"]
    model = parse_model(TomlSource("\n".join(text)))
    rows = ['# format = "abbe-campaign/1"', '# instrument = "laser"']
    rows += ['# [setups.line]\n# free = ["zero"]']
    rows.append("time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value")
    time = 0
    for _ in range(3):
        there = np.arange(3.0, 398.0, 7.3)
        for x, s in [(v, 1) for v in there] + [(v, -1) for v in there[::-1]]:
            e = eval(error, {"np": np, "x": x, "s": s})  # noqa: S307 - the test's own formula
            value = 1e3 * e + rng.normal(0.0, 0.1)
            rows.append(f"{time},line,displacement,{x:.3f},200,200,{s},1,0,0,{value:.4f}")
            time += 5
    return model, as_campaign("\n".join(rows) + "\n", model)


def test_a_plain_backlash_is_called_a_backlash() -> None:
    model, campaign = line(1, "0.6e-3 * s")
    found = diagnose(model, campaign)
    assert found.established[0].effect.spec == "backlash axis=X"
    alike = {a.found.candidate.effect.kind for a in found.established[0].aliases}
    assert "reversal_angle" in alike


def test_a_cyclic_error_with_a_second_harmonic_is_one_cause() -> None:
    model, campaign = line(
        2, "2.4e-3 * np.sin(2*np.pi*x/10) + 0.7e-3 * np.cos(4*np.pi*x/10) + 1e-5 * x"
    )
    found = diagnose(model, campaign)
    specs = [e.effect.spec for e in found.established]
    assert "cyclic axis=X harmonics=2" in specs
    (cyclic,) = [e for e in found.established if e.effect.kind == "cyclic"]
    assert {e.name: e.value for e in cyclic.estimates}["period"] == pytest.approx(10.0, abs=0.01)


def test_what_is_not_determined_stays_believable() -> None:
    """Two columns that are one: least norm, and uncertain by what is plausible."""
    rng = np.random.default_rng(0)
    one = rng.normal(size=200)
    columns = np.column_stack([one, one * (1.0 + 1e-9)])
    value, sd = least_norm(columns, 3.0 * one, np.array([10.0, 10.0]), 1.0)
    assert value == pytest.approx([1.5, 1.5], abs=0.01)
    assert (sd > 1.0).all()
    assert (sd < 10.0).all()


def test_absurd_values_cost_more_than_doubtful_ones() -> None:
    def at(value: float) -> float:
        plausible = abs(value) <= 1.0
        return doubt_of([Estimate("k", "mm", value, 0.01, plausible, (-1.0, 1.0), "")])

    assert at(0.5) == 0.0
    assert 0.0 < at(1.5) < at(15.0) < at(11_200.0)
