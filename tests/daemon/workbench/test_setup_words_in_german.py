"""What a person is told to set up, in German: of every instrument and set-up of a plan."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.setups.candidates import possible
from abbe.compcore.planning.setups.gauges import probed_gauges
from abbe.compcore.planning.setups.plates import probed_plates
from abbe.daemon.measure.events import setup_words
from tests.support.compcore.survey_machines import task
from tests.support.daemon.german import english_of

WORDS = Path(__file__).parents[3] / "daemon" / "workbench" / "static" / "words" / "de.json"
LABELS: dict[str, str] = json.loads(WORDS.read_text("utf-8"))["_labels"]
PATTERNS = [
    (re.compile(re.sub(r"\\{(\w+)\\}", r"(?P<\1>.+)", re.escape(english))), own)
    for english, own in LABELS.items()
    if "{" in english
]


def label(text: str) -> str:
    """As the page has it (`static/shared/language.js`)."""
    if text in LABELS:
        return LABELS[text]
    for pattern, own in PATTERNS:
        if found := pattern.fullmatch(text):
            return own.format(**{name: label(value) for name, value in found.groupdict().items()})
    return text


def test_every_set_up_of_a_plan_is_said_in_german() -> None:
    said = set()
    for structure in ("bridge", "rotary table"):
        for setup in possible(task(structure), tuple(INSTRUMENTS.values())):
            said.add(f"set up {setup_words(replace(setup, name='01_setup'))}")
    assert len(said) > 100
    english = [text for text in said if not english_of(text)]
    assert len(english) < len(said) / 2  # the look itself finds English
    left = sorted({label(text) for text in said if english_of(label(text))})
    assert left == []


def test_every_placing_of_a_plate_and_a_gauge_is_said_in_german() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [80.0, 0.0, 0.0], [0.0, 80.0, 0.0]])
    plate = CalibratedPlate(("1", "2", "3"), corners, 22.0)
    gauge = CalibratedGauge(("1", "2"), np.array([0.0, 200.0]), 16.0, 20.0)
    asked = replace(task("bridge"), plate=plate, gauge=gauge)
    setups = [
        *probed_plates(asked, INSTRUMENTS["ball-plate"], plate),
        *probed_gauges(asked, INSTRUMENTS["gauge-block"], gauge),
    ]
    said = {f"set up {setup_words(replace(s, name='01_setup'))}" for s in setups}
    assert len(said) > 40
    assert sorted({label(text) for text in said if english_of(label(text))}) == []
