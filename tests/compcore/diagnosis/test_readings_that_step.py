"""A display that steps: how readings were rounded is no curve of the machine."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.campaign_notes import stepping
from abbe.compcore.diagnosis.stepwise import Course, to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

MILL = """format = "abbe-model/1"
[machine]
name = "mill"
structure = "w b X Y Z t"
[machine.axes.X]
travel = [0.0, 800.0]
[machine.axes.Y]
travel = [0.0, 500.0]
[machine.axes.Z]
travel = [-400.0, 0.0]
"""
HEAD = """# format = "abbe-campaign/1"
# [setups.LX]
# free = ["zero"]
# [setups.LY]
# free = ["zero"]
time,setup,kind,X,Y,Z,X_dir,Y_dir,ux,uy,uz,value
"""
PPM = {"X": 21.0, "Y": -13.0}
PLAY = 2.3


def read_in_steps(step: float, model: Model) -> Campaign:
    """Lines along X and Y, three times there and back, that a display rounds; µm."""
    rng = np.random.default_rng(3)
    rows, time = [], 0
    for axis, length in (("X", 800.0), ("Y", 500.0)):
        for way in [1, -1] * 3:
            for at in np.arange(0.0, length + 1.0, 40.0)[::way]:
                value = PPM[axis] * at * 1e-3 + PLAY * (way > 0) + rng.normal(0.0, 0.3)
                time += 10
                x, y = (at, 250.0) if axis == "X" else (400.0, at)
                ways = f"{way},1" if axis == "X" else f"1,{way}"
                along = "1,0,0" if axis == "X" else "0,1,0"
                shown = np.round(value / step) * step
                rows.append(f"{time},L{axis},displacement,{x},{y},-200,{ways},{along},{shown:g}\n")
    return as_campaign(HEAD + "".join(rows), model)


def went(step: float) -> Course:
    model = parse_model(TomlSource(MILL))
    return to_the_verdict(model, read_in_steps(step, model))


def test_rounding_is_not_described() -> None:
    course = went(5.0)
    assert all(step.action != "described" for step in course.steps)
    found = {e.spec for e in course.last.result.model.effects}
    assert {"scale axis=X", "scale axis=Y", "backlash axis=X"} <= found
    (scale,) = (t for t in course.last.result.model.terms if t.effect.spec == "scale axis=X")
    assert scale.values["k"].value == pytest.approx(PPM["X"] * 1e-6, abs=2e-6)
    words = stepping(course.diagnosis)
    assert words is not None
    assert "in steps of 5 µm: by that alone each is unsure by 1.4 µm" in words


def test_a_fine_step_is_not_worth_a_word() -> None:
    assert stepping(went(0.1).diagnosis) is None
