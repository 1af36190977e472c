"""Thermometers without their noise: what a body did is what comes out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.steady_thermometers import (
    steadied,
    steady_readings,
    unsteady,
    unsteady_words,
)
from abbe.compcore.comparison.compare import compare
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from benchmarks.sources.campaigns import Rows

TIME = np.cumsum(np.tile([400.0, *[10.0] * 24], 16))
"""Sixteen lines of 25 targets, and what it takes to set each up."""
WARM = 21.0 + 1.4 * np.sin(2.0 * math.pi * TIME / 26000.0)
MACHINE = Machine(
    "",
    Structure.parse("w b X Y Z t"),
    {"X": Axis("X", (0.0, 2800.0)), "Y": Axis("Y", (0.0, 900.0)), "Z": Axis("Z", (-500.0, 0.0))},
    {"T_x": Signal("T_x", role="scale", axis="X"), "load": Signal("load", role="load", unit="kg")},
)


def campaign(reads: np.ndarray, expands: np.ndarray, *, sd: float = 0.4e-3, seed: int = 3):
    """Lines of a laser along X with a zero each: a scale of 9.5 ppm/K, and one thermometer."""
    rows, x = Rows(("X", "Y", "Z")), np.linspace(0.0, 2800.0, 25)
    noise = np.random.default_rng(seed).normal(0.0, sd, len(TIME))
    for k in range(len(TIME) // 25):
        at = slice(25 * k, 25 * k + 25)
        value = 9.5e-6 * x * (expands[at] - 20.0) + noise[at]
        place = {"X": x, "Y": np.full(25, 300.0), "Z": np.full(25, -100.0)}
        rows.add(f"line{k}", Kind.DISPLACEMENT, place, value, sd,
                 u=(1.0, 0.0, 0.0), time=TIME[at], signals={"T_x": reads[at]})  # fmt: skip
    return rows.campaign("laser")


def test_white_noise_goes_and_what_the_body_did_stays() -> None:
    read = WARM + np.random.default_rng(1).normal(0.0, 0.03, len(TIME))
    steady = steady_readings(TIME, read)
    assert np.sqrt(np.mean((steady - WARM) ** 2)) < 0.006
    found = unsteady(campaign(read, WARM), MACHINE)["T_x"]
    assert found.scatter == pytest.approx(0.03, rel=0.1)
    assert found.step == 0.0


@pytest.mark.parametrize(
    "read",
    [
        np.repeat(np.linspace(20.0, 27.0, 16), 25),
        np.repeat(np.linspace(20.0, 24.0, 4), 100) + 0.25,
        np.random.default_rng(4).uniform(18.0, 26.0, len(TIME)),
    ],
    ids=["evenly apart", "whole degrees and a quarter", "another one for every row"],
)
def test_temperatures_that_somebody_chose_stay_as_they_are(read: np.ndarray) -> None:
    """A climate chamber's runs, evenly apart, are no display's steps; and 2 K are no noise."""
    found = campaign(read, read)
    assert unsteady(found, MACHINE) == {}
    assert (steadied(found, MACHINE).conditions.signals["T_x"] == read).all()


def test_a_jump_stays_where_it_was_read() -> None:
    """Coolant hits a sensor: 0.5 K from one reading to the next are not laid over those beside."""
    jump = np.where(np.arange(len(TIME)) >= 210, 0.5, 0.0)
    read = WARM + jump + np.random.default_rng(1).normal(0.0, 0.02, len(TIME))
    steady = steady_readings(TIME, read)
    assert np.abs(steady - WARM - jump).max() < 0.1 + 3.0 * 0.02
    far = np.abs(np.arange(len(TIME)) - 210) > 30
    assert np.sqrt(np.mean((steady - WARM - jump)[far] ** 2)) < 0.012


def test_steps_are_followed_between_their_edges() -> None:
    read = np.round(WARM / 0.4) * 0.4
    steady = steady_readings(TIME, read)
    assert np.sqrt(np.mean((steady - WARM) ** 2)) < 0.5 * np.sqrt(np.mean((read - WARM) ** 2))
    made = steadied(campaign(read, WARM), MACHINE)
    (words,) = unsteady_words(made, MACHINE)
    assert "T_x comes in steps of 0.4 K, so each reading is off by up to ±0.2 K" in words
    assert "±5.6 µm at 2800 mm" in words


def test_what_a_body_does_at_once_is_kept() -> None:
    """A spindle's thermometer that goes up by 6 K in a minute, and falls again."""
    up = (TIME % 5000.0) / 40.0
    read = 22.0 + 6.0 * np.exp(-up / 8.0) * (up > 1.0)
    assert np.abs(steady_readings(TIME, read) - read).max() < 0.5


def test_no_clock_few_readings_and_other_signals_are_left() -> None:
    noisy = WARM + np.random.default_rng(1).normal(0.0, 0.03, len(TIME))
    assert np.array_equal(steady_readings(TIME[:20], noisy[:20]), noisy[:20])
    made = campaign(noisy, WARM)
    again = steadied(steadied(made, MACHINE), MACHINE)
    once = steadied(made, MACHINE)
    assert np.array_equal(again.conditions.signals["T_x"], once.conditions.signals["T_x"])
    unknown = Machine("", MACHINE.structure, MACHINE.axes, {})
    assert steadied(made, unknown) is made


def test_an_expansion_is_as_large_as_it_is() -> None:
    """Each line has its own zero: within one the scale warms by as much as the noise of a reading.

    Noise on what is multiplied makes what multiplies it too small, the more the noisier.
    """
    model, _ = with_effect(Model(MACHINE, ()), "scale_expansion", {"axis": "X", "signals": ["T_x"]})
    short = 20.0 + 0.02 * np.sin(2.0 * math.pi * TIME / 3000.0)
    read = short + np.random.default_rng(2).normal(0.0, 0.02, len(TIME))
    result = fit(model, campaign(read, short, sd=0.05e-3))
    value = result.model.terms[0].values["alpha"]
    assert value.value == pytest.approx(9.5e-6, rel=0.12)
    left = compare(result.model, campaign(read, short, sd=0.05e-3, seed=5)).lengths.rms
    assert left < 0.12e-3
