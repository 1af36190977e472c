"""One run: days made, the loop gone through from the bare machine, all judged by later days."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import Course, to_the_verdict
from abbe.compcore.effects.base import Effect
from abbe.compcore.files.campaign_file import read_campaigns
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from benchmarks.thermal import learners
from benchmarks.thermal.days import SD, Days, make, write
from benchmarks.thermal.outcome import Outcome
from benchmarks.thermal.scenario import Run

THERMAL = (
    "thermal_offset",
    "thermal_tilt",
    "thermal_bending",
    "scale_expansion",
    "screw_heating",
    "workpiece_expansion",
)
UNSEEN_CAUSE = ("warm_up", "drift")
"""What a cause without any thermometer may be called."""

SHARE = 0.1
"""Part of a reading's movement from which on a source counts as its cause."""


def files(days: Days) -> tuple[Model, Campaign, Campaign]:
    """The model, the days to learn from and the later ones, through the readers of files."""
    model = parse_model(TomlSource(days.model))
    with tempfile.TemporaryDirectory() as folder:
        seen = read_campaigns(write(days.seen, Path(folder), "seen"), model.machine)
        unseen = read_campaigns(write(days.unseen, Path(folder), "later"), model.machine)
    return model, seen, unseen


def run(one: Run, *, others: bool = True) -> Outcome:
    """Make the days of a run, go through the loop, judge; `others`: black boxes too."""
    with threads_for(0):
        days = make(one)
        model, seen, unseen = files(days)
        start = time.process_time()
        course = to_the_verdict(model, seen)
        seconds = time.process_time() - start
        rms = {
            "before": learners.rms(unseen.value, unseen),
            "floor": 1e-3 * days.floor,
            "abbe": held_out(course, unseen),
        }
        foretold = {"spreadsheet": learners.spreadsheet(seen, unseen)}
        if others and one.scenario.warms:
            foretold |= learners.boxes(course.steps[0].result, unseen)
        rms |= {name: learners.rms(unseen.value - v, unseen) for name, v in foretold.items()}
    known = {e.spec for e in model.effects}
    added = [e for e in course.last.result.model.effects if e.spec not in known]
    # in the order in which they came
    order = [s.effect.spec for s in course.steps if s.effect is not None]
    added.sort(key=lambda e: order.index(e.spec))
    false = [e for e in added if not plausible(e, days)]
    return Outcome(
        one.scenario.name,
        one.seed,
        {name: round(1e3 * value, 4) for name, value in rms.items()},
        tuple(e.spec for e in added),
        tuple(e.spec for e in false),
        wanted(days),
        bool(added) and added[0] not in false,
        round(seconds, 1),
    )


def with_others(one: Run, kept: Outcome) -> Outcome:
    """An outcome that was had without the black boxes, with what they foretell."""
    with threads_for(0):
        model, seen, unseen = files(make(one))
        boxes = learners.boxes(fit(model, seen), unseen)
        rms = {name: learners.rms(unseen.value - v, unseen) for name, v in boxes.items()}
    return replace(kept, rms={**kept.rms, **{n: round(1e3 * v, 4) for n, v in rms.items()}})


def held_out(course: Course, unseen: Campaign) -> float:
    """RMS on later days of the model that the loop ends with, mm; what the instrument did apart."""
    fitted = course.last.result.model
    kept = tuple(
        t if t.effect.scope != "instrument" or t.effect.reads_model else replace(t, values={})
        for t in fitted.terms
    )
    beside = compare(replace(fitted, terms=kept, covariance=None), unseen)
    return learners.rms(beside.residual, unseen)


def wanted(days: Days) -> tuple[str, ...]:
    """Directions that move by more than the noise, with the sources that move them."""
    found = []
    for k, letter in enumerate("XYZ"):
        sources = _sources(days, letter)
        if sources and np.hypot.reduce([days.moved[s][k] for s in sources]) > SD:
            found.append(f"{letter}: {', '.join(sources)}")
    return tuple(found)


def plausible(effect: Effect, days: Days) -> bool:
    """Whether something in the shop moves the machine so, and what the effect reads with it.

    A thermal effect in a direction that the machine moves in, by thermometers that the same source
    moves; or a warm-up or drift where a source moves the machine and no thermometer follows it.
    """
    sources = {s for letter in _directions(effect) for s in _sources(days, letter)}
    if effect.kind in THERMAL:
        return any(sources & _moves(days, signal) for signal in effect.signals_needed())
    if effect.kind in UNSEEN_CAUSE:
        seen = set().union(*(_moves(days, s) for s in days.read))
        return bool(sources - seen)
    return False


def _sources(days: Days, letter: str) -> list[str]:
    """What moves the machine in a direction by more than half of a reading's noise."""
    k = "XYZ".index(letter)
    return [s for s, m in days.moved.items() if m[k] > 0.5 * SD]


def _moves(days: Days, signal: str) -> set[str]:
    """What moves a reading, by a tenth of all that moves it."""
    read = days.read[signal]
    whole = float(np.hypot.reduce(list(read.values())))
    return {s for s, v in read.items() if v > SHARE * whole}


def _directions(effect: Effect) -> str:
    """Directions in which an effect moves the tool."""
    direction = getattr(effect, "direction", None)
    if direction is not None:
        return str(direction)
    if effect.kind == "workpiece_expansion":
        return "XYZ"
    about = getattr(effect, "about", None)
    if about is not None:
        return "".join(k for k in "XYZ" if k != about)
    return str(getattr(effect, "axis", ""))
