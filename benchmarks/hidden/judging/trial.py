"""One trial: a scenario made, diagnosed, given to other learners, and judged on unseen lines."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis import Diagnosis, diagnose
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.causes.cause import READING, Cause
from benchmarks.hidden.judging.inputs import Inputs, Learnt, Term, inputs
from benchmarks.hidden.judging.outcome import Outcome
from benchmarks.hidden.judging.readable import readable
from benchmarks.hidden.judging.score import score
from benchmarks.hidden.scenario import Scenario, hide
from benchmarks.hidden.scenes.scene import scene

LEADING = 3
"""Terms of a sparse regression that are kept."""

F64 = NDArray[np.float64]
Answer = tuple[str, Mapping[str, Any]]
"""Kind and where-keys of an effect."""
Learner = Callable[[FitResult, Inputs, Inputs], Learnt]
"""From a fitted model, what its campaign and an unseen one recorded."""
T = TypeVar("T")


def as_campaign(text: str, model: Model) -> Campaign:
    """A simulated campaign's text as the reader of campaign files takes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.csv"
        path.write_text(text, encoding="utf-8")
        return read_campaign(path, model.machine)


def run(scenario: Scenario, learners: Mapping[str, Learner] | None = None) -> Outcome:
    """Simulate, diagnose, add what was named, look at unseen lines; with one thread.

    `learners`: others that learn from the same campaign, by the name that `Outcome.rms` has.
    """
    with threads_for(0):
        return _run(scenario, learners or {})


def _run(scenario: Scenario, learners: Mapping[str, Learner]) -> Outcome:
    stage = scene(scenario.seed, scenario.kind)
    hidden = hide(scenario, stage)
    causes = [cause for cause, _ in hidden]
    model = parse_model(TomlSource(stage.model_text([c.omits for c in causes if c.omits])))
    campaign = as_campaign(stage.simulate(hidden).text, model)
    # the instrument's errors are not the machine's: unseen lines are measured without them
    clean = [(cause, size) for cause, size in hidden if cause.place != READING]
    unseen = as_campaign(stage.simulate(clean, held_out=True).text, model)
    seconds: dict[str, float] = {}
    diagnosis = _timed(seconds, "abbe", partial(diagnose, model, campaign))
    named = [e.found.candidate.effect for e in diagnosis.established]
    offered = _offered(diagnosis)
    added: list[Answer] = [(e.kind, e.where()) for e in named] + offered
    truth = _truth(causes)
    rms = dict.fromkeys(("before", "oracle", "abbe", "process", "boosting", "lasso"), float("nan"))
    rms["before"] = _held_out(model, [], campaign, unseen)
    rms["abbe"] = _held_out(model, added, campaign, unseen) if added else rms["before"]
    if truth is not None:
        rms["oracle"] = _held_out(model, truth, campaign, unseen)
    terms: tuple[Term, ...] = ()
    seen, other = inputs(diagnosis.result, unseen)
    for name, learner in learners.items():
        learnt = _timed(seconds, name, partial(learner, diagnosis.result, seen, other))
        rms[name] = _left(model, campaign, unseen, learnt.seen, learnt.unseen)
        terms = learnt.terms or terms
    return Outcome(
        scenario,
        diagnosis.verdict,
        tuple(e.spec for e in named),
        " ".join(f"{k}={v}" for _, where in offered for k, v in where.items()),
        score(diagnosis, causes),
        all(c.answers for c in causes),
        rms,
        len(terms),
        tuple(map(str, terms[:LEADING])),
        readable(terms, causes),
        seconds,
    )


def _timed(seconds: dict[str, float], name: str, work: Callable[[], T]) -> T:
    start = time.process_time()
    found = work()
    seconds[name] = round(time.process_time() - start, 2)
    return found


def _offered(diagnosis: Diagnosis) -> list[Answer]:
    """The empirical formula that is offered for what no cause explains, if any."""
    for structure in diagnosis.structure[:1]:
        pattern = structure.pattern
        if pattern.terms:
            terms = [t.replace(" ", "") for t in pattern.terms]
            return [("formula", {"channel": str(pattern.error_motion), "terms": terms})]
    return []


def _truth(causes: Sequence[Cause]) -> list[Answer] | None:
    """The effects that who knows the truth would add; None where none says it."""
    found: list[Answer] = []
    for cause in causes:
        if cause.answers:
            found.append(cause.answers[0])
        elif cause.formula:
            channel, terms = cause.formula
            found.append(("formula", {"channel": channel, "terms": list(terms)}))
        else:
            return None
    return found


def _held_out(
    model: Model, effects: Sequence[Answer], campaign: Campaign, unseen: Campaign
) -> float:
    """RMS on unseen lines after adding effects, mm."""
    for kind, where in effects:
        model, _ = with_effect(model, kind, where)
    nothing = np.zeros(campaign.n), np.zeros(unseen.n)
    return _left(model, campaign, unseen, *nothing)


def _left(model: Model, campaign: Campaign, unseen: Campaign, taken: F64, there: F64) -> float:
    """RMS on unseen lines of a model fitted to what a correction leaves, mm.

    `taken` and `there`, (n,): the correction at the rows of the campaign and of the unseen lines.
    """
    fitted = fit(model, replace(campaign, value=campaign.value - taken)).model
    # what was fitted of the instrument is no part of the compensation
    kept = tuple(
        t if t.effect.scope != "instrument" or t.effect.reads_model else replace(t, values={})
        for t in fitted.terms
    )
    fitted = replace(fitted, terms=kept, covariance=None)
    return compare(fitted, replace(unseen, value=unseen.value - there)).lengths.rms
