"""A handful of readings, noisy or exact to the last digit, is no reason to crash."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.noise import noise_floor
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.diagnosis.words import diagnosis_words
from abbe.compcore.errors import AbbeError
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging import trial

BARE = parse_model(
    TomlSource(
        "\n".join(
            ['format = "abbe-model/1"', "[machine]", 'name = "m"', 'structure = "w b Y X Z t"']
            + [f"[machine.axes.{axis}]\ntravel = [-400.0, 500.0]" for axis in "XYZ"]
        )
    )
)
COLUMNS = "time,setup,kind,X,Y,Z,tool_x,tool_y,tool_z,ux,uy,uz,value,sd"


def campaign(rows: list[tuple[float, float, str]], free: str) -> Campaign:
    head = ['# format = "abbe-campaign/1"']
    for name in sorted({name for _, _, name in rows}):
        head += [f"# [setups.{name}]", f"# free = {free}"]
    lines = [
        f"{10 * i},{name},displacement,{x:g},0,0,0,0,-100,1,0,0,{value:g},0.5"
        for i, (x, value, name) in enumerate(rows)
    ]
    return trial.as_campaign("\n".join([*head, COLUMNS, *lines]) + "\n", BARE)


@pytest.mark.parametrize("slope", [0.02, 0.04, 0.08])
def test_three_readings_on_a_line(slope: float) -> None:
    """Nothing is left then, and nothing was divided by."""
    rows = [(x, slope * x, "one") for x in (0.0, 100.0, 200.0)]
    assert diagnose(BARE, campaign(rows, "[]")).verdict in ("missing", "unexplained")


def test_a_handful_on_a_line_names_its_scale() -> None:
    """18 µm over the travel, 0.3 µm beside the line: nothing is called noise."""
    off = [0.1, -0.3, 0.2, -0.1, 0.2]
    rows = [(x, 0.02 * x + off[i], "one") for i, x in enumerate(np.linspace(-400, 500, 5))]
    found = diagnose(BARE, campaign(rows, '["zero"]'))
    text = " ".join(diagnosis_words(found, noise_floor(found.whole.problem.campaign), [], str))
    assert found.verdict == "missing"
    assert "scale axis=X" in text
    assert "residuals are noise" not in text


READINGS = st.lists(
    st.tuples(
        st.sampled_from([-100.0, 0.0, 50.0, 100.0, 200.0]),
        st.sampled_from([0.0, 2.0, 4.0, 8.0, -3.1]),
        st.sampled_from(["one", "two"]),
    ),
    min_size=1,
    max_size=6,
)


@settings(max_examples=25)
@given(READINGS, st.sampled_from(["[]", '["zero"]', '["zero", "slope"]']))
def test_a_few_readings_are_diagnosed_or_refused_in_words(
    rows: list[tuple[float, float, str]], free: str
) -> None:
    try:
        course = to_the_verdict(BARE, campaign(rows, free))
    except AbbeError:
        return
    assert course.diagnosis.verdict in ("complete", "missing", "unexplained")
