"""ISO 230-2 with five targets: between them a model says no more than what was read there."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.noise import noise_floor
from abbe.compcore.campaign.targets import targets
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.fitting.words import fit_words
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging import trial

SLIT = parse_model(
    TomlSource(
        'format = "abbe-model/1"\n[machine]\nname = "slit"\nstructure = "w b X t"\n'
        "[machine.axes.X]\ntravel = [0.0, 70.0]\n"
    )
)
THERE = np.array([15.0, 25.2, 35.4, 45.6, 55.8])
UP = np.array([0.1, 19.2, -15.9, -22.6, 12.1])
"""µm, the error at each target on the way there."""


def five_targets(beyond: float, down: np.ndarray, seed: int = 1) -> Campaign:
    """Five cycles there and back; back each target lies `beyond` mm farther out."""
    rng = np.random.default_rng(seed)
    lines = ['# format = "abbe-campaign/1"', "setup,kind,X,X_dir,ux,uy,uz,value"]
    for _ in range(5):
        for way, at, error in ((1, THERE, UP), (-1, THERE[::-1] + beyond, down[::-1])):
            lines += [
                f"run,displacement,{x:g},{way},1,0,0,{e + rng.normal(0.0, 0.3):.3f}"
                for x, e in zip(at, error, strict=True)
            ]
    return trial.as_campaign("\n".join(lines) + "\n", SLIT)


def said(model: Model, at: np.ndarray, way: float) -> np.ndarray:
    """Predicted error, µm."""
    where = Conditions({"X": at}, directions={"X": np.full(len(at), way)})
    return 1e3 * model.predict(where).translation[:, 0]


@pytest.mark.parametrize("beyond", [0.0, 0.2])
@pytest.mark.parametrize("play", [0.0, 6.0, "as it comes"])
def test_between_targets_nothing_is_said_that_was_not_read(beyond, play):
    down = UP + (np.array([4.0, -11.0, 3.0, 13.0, -2.0]) if isinstance(play, str) else -play)
    model = to_the_verdict(SLIT, five_targets(beyond, down)).last.result.model
    at = np.linspace(15.0, 56.0, 200)
    for way, read, place in ((1.0, UP, THERE), (-1.0, down, THERE + beyond)):
        between = said(model, at, way)
        shift = float(np.mean(said(model, place, way) - read))
        np.testing.assert_allclose(said(model, place, way) - shift, read, atol=1.5)
        assert (between - shift).max() < read.max() + 3.0
        assert (between - shift).min() > read.min() - 3.0


def test_a_fit_says_where_its_curve_runs_away():
    """What `abbe new` asks for is fitted, and what it says of the ends that nobody read is said."""
    at_hand = SLIT.with_effects(make_effect("positioning", {"axis": "X", "shape": "spline:6"}))
    campaign = five_targets(0.2, UP - 3.0)
    result = fit(at_hand, campaign)
    lines = list(fit_words(result, noise_floor(campaign, SLIT.machine)))
    (fine,) = [line for line in lines if line.startswith("TOO FINE")]
    assert "shape=table positions=15.1,25.3,35.5,45.7,55.9" in fine
    (away,) = [line for line in lines if line.startswith("RUNS AWAY")]
    assert "where it was measured it stays within" in away


def test_nothing_runs_away_where_the_whole_travel_was_read():
    at = np.tile(np.linspace(0.0, 70.0, 15), 4)
    lines = ['# format = "abbe-campaign/1"', "setup,kind,X,ux,uy,uz,value"]
    lines += [f"run,displacement,{x:g},1,0,0,{20.0 * np.sin(x / 12.0):.3f}" for x in at]
    campaign = trial.as_campaign("\n".join(lines) + "\n", SLIT)
    at_hand = SLIT.with_effects(make_effect("positioning", {"axis": "X", "shape": "spline:6"}))
    said = list(fit_words(fit(at_hand, campaign), noise_floor(campaign, SLIT.machine)))
    assert not [line for line in said if line.startswith(("TOO FINE", "RUNS AWAY"))]


def test_targets_that_only_the_way_back_meets_elsewhere_are_one():
    found = targets(five_targets(0.2, UP).conditions, "X", rotary=False)
    np.testing.assert_allclose(found, THERE + 0.1)


def test_fine_steps_within_one_way_stay_apart():
    """A periodic test beside five far targets (ISO 230-2, 5.3) is read at its own places."""
    fine = [*THERE, 15.5, 16.0, 16.5]
    at = np.tile(np.sort(fine), 4)
    way = np.repeat([1.0, -1.0, 1.0, -1.0], len(fine))
    found = targets(Conditions({"X": at}, directions={"X": way}), "X", rotary=False)
    assert len(found) == len(fine)
