"""The front door's arguments: a model does for its machine; another thing is one clear error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import abbe

FOLDER = Path("tests/data/p01-mill")
MODEL = abbe.load_model(FOLDER / "model.toml")
CAMPAIGN = abbe.read_campaigns([FOLDER / "check.csv"], MODEL.machine)


def test_a_model_does_for_its_machine() -> None:
    again = abbe.read_campaigns([FOLDER / "check.csv"], MODEL)
    np.testing.assert_array_equal(again.value, CAMPAIGN.value)
    assert str(abbe.noise_floor(CAMPAIGN, MODEL)) == str(abbe.noise_floor(CAMPAIGN, MODEL.machine))
    assert abbe.make_controller("csv", MODEL).machine is MODEL.machine
    by_model, by_machine = (abbe.evaluate_iso230(CAMPAIGN, m) for m in (MODEL, MODEL.machine))
    assert repr(by_model) == repr(by_machine)


def test_one_file_need_not_stand_in_a_list() -> None:
    for path in (FOLDER / "check.csv", str(FOLDER / "check.csv")):
        np.testing.assert_array_equal(abbe.read_campaigns(path, MODEL).value, CAMPAIGN.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: abbe.read_campaigns(["a.csv"], CAMPAIGN), "machine: found Campaign, expected Mac"),
        (lambda: abbe.read_switched("a.csv", "mill"), "machine: found str, expected Machine or Mo"),
        (lambda: abbe.make_controller("csv", None), "machine: found NoneType, expected Machine or"),
        (lambda: abbe.noise_floor(MODEL, CAMPAIGN), "campaign: found Model, expected Campaign"),
        (lambda: abbe.noise_floor(CAMPAIGN, "mill"), "machine: found str, expected Machine or Mo"),
        (lambda: abbe.evaluate_iso230(MODEL, CAMPAIGN), "campaign: found Model, expected Campaign"),
        (lambda: abbe.fit(CAMPAIGN, MODEL), "model: found Campaign, expected Model"),
        (lambda: abbe.fit(MODEL, "day1.csv"), "campaign: found str, expected Campaign"),
        (lambda: abbe.compare("model.toml", CAMPAIGN), "model: found str, expected Model"),
        (lambda: abbe.compare(MODEL, [CAMPAIGN]), "campaign: found list, expected Campaign"),
        (lambda: abbe.diagnose(MODEL.machine, CAMPAIGN), "model: found Machine, expected Model"),
        (lambda: abbe.advise(MODEL), "diagnosis: found Model, expected Findings"),
        (lambda: abbe.add_effect(MODEL.machine, "mass"), "model: found Machine, expected Model"),
        (lambda: abbe.remove_effect("model.toml", "a"), "model: found str, expected Model"),
        (lambda: abbe.save_model(MODEL.machine, "a.toml"), "model: found Machine, expected Model"),
        (lambda: abbe.write_campaign(MODEL, "a.csv"), "campaign: found Model, expected Campaign"),
        (lambda: abbe.uncompensated(MODEL, CAMPAIGN), "campaign: found Model, expected Campaign"),
        (lambda: abbe.motion_curves(MODEL.machine, "X"), "model: found Machine, expected Model"),
        (lambda: abbe.error_map(None, ("X", "Y"), {}), "model: found NoneType, expected Model"),
        (lambda: abbe.prediction_sd(MODEL, {"X": 0.0}), "conditions: found dict, expected Condit"),
        (lambda: MODEL.predict({"X": 0.0}), "conditions: found dict, expected Conditions"),
        (lambda: abbe.Compensator(MODEL.machine), "model: found Machine, expected Model"),
        (lambda: abbe.project_tables(MODEL, "csv"), "capability: found str, expected Capability"),
        (lambda: abbe.import_map("map.txt", "w b Y X Z t"), "compensation: found str, expected C"),
        (lambda: abbe.identify(None, [], "w b t"), "points: found list, expected SwitchedPoints"),
        (lambda: abbe.recorded(MODEL, MODEL, date="", version="", noise_floor=None),
         "result: found Model, expected FitResult"),
    ],
)  # fmt: skip
def test_another_thing_is_one_clear_error(call: Callable[[], object], message: str) -> None:
    with pytest.raises(TypeError) as caught:
        call()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_where_the_right_thing_stands_in_what_was_given() -> None:
    result = abbe.fit(MODEL, CAMPAIGN)
    for wrong in (lambda: abbe.compare(result, CAMPAIGN), lambda: abbe.Compensator(result)):
        with pytest.raises(TypeError) as caught:
            wrong()
        assert str(caught.value) == "model: found FitResult, expected Model (its .model is one)"
    assert abbe.compare(result.model, CAMPAIGN).lengths.rms > 0.0


def test_every_function_of_the_front_door_says_so() -> None:
    """Every exported call that takes one of Abbe's own things is in the list above."""
    own = ("Model", "Machine", "Campaign", "FitResult", "Findings", "CompensationMap",
           "SwitchedPoints", "Conditions", "Capability")  # fmt: skip
    taking = {
        name
        for name in abbe.__all__
        if not isinstance(getattr(abbe, name), type)
        and any(
            str(kind).split(" | ")[0].split("[")[0] in own
            for argument, kind in getattr(abbe, name).__annotations__.items()
            if argument != "return"
        )
    }
    tested = Path(__file__).read_text(encoding="utf-8").split("def test_another_thing")[0]
    assert {name for name in taking if f"lambda: abbe.{name}(" not in tested} == set()
    assert len(taking) > 15
