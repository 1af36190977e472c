"""``abbe diagnose --apply``: every step to the verdict with its error, and the model reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.hidden_waves import hidden_waves
from abbe.compcore.diagnosis.stepwise import Course, Step, to_the_verdict
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.files.model_file import save_model
from abbe.compcore.files.model_toml.campaign_record import campaign_records, noise_by_file
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.model.course import peak_to_valley, play
from abbe.compcore.model.model import Model, Term
from abbe.compcore.units import in_digits, read_in, with_uncertainty
from abbe.daemon.answers.inputs import now
from abbe.daemon.answers.model.fit import finite
from abbe.daemon.answers.model.held_out import HeldOutCampaigns, shares
from abbe.daemon.installed import abbe_version

_SAID = {
    "began": "the model as it is",
    "added": "added {0}",
    "added together": "added with the next, as neither says it alone: {0}",
    "lagged": "behind a lag: {0}",
    "second body": "a second body follows the same signal: {0}",
    "began elsewhere": "not in equilibrium at first: {0}",
    "described": "described, not explained: {0}",
    "removed": "taken out again, as the others say it too: {0}",
    "composed": 'angles are too large to add up: composition = "exact" from here on',
    "set aside": "left out, as nothing measured beside agrees: {0}",
}

_NOTHING = 1e-9
"""µm, µrad: a standard uncertainty below this is none, the value a convention."""


def _what(step: Step) -> str:
    """The effect of a step, or the readings."""
    if step.effect is not None:
        return step.effect.spec
    named = [f"{Path(s.file).name}, line {s.line}" for s in step.strays[:_LISTED]]
    more = len(step.strays) - len(named)
    return "; ".join(named) + (f" and {more} more" if more else "")


_LISTED = 3
_SINGLE = 3
"""Coefficients of a shape that say something one by one."""


@dataclass(frozen=True)
class StepFigures:
    """One step in the unit of its campaign.

    Attributes
    ----------
    step
        The step.
    unit, json_unit
        ``µm`` and ``um``, or ``µrad`` and ``urad``.
    rms, held_out
        Of the fitted rows, and of blocks left out of the fit.
    unseen
        Of campaigns that were never fitted; None without any.
    unseen_records
        What the model keeps of those campaigns.
    """

    step: Step
    unit: str
    json_unit: str
    rms: float
    held_out: float
    unseen: float | None
    unseen_records: tuple[Mapping[str, Any], ...] = ()

    @classmethod
    def of(cls, step: Step, unseen: Campaign | None) -> StepFigures:
        """The figures of a step."""
        rms = step.result.rms(*step.kinds)
        rotations = step.of_rotations
        factor = 1e6 if rotations else 1e3
        out = step.held_out.rotations if rotations else step.held_out.lengths
        other: float | None = None
        records: tuple[Mapping[str, Any], ...] = ()
        if unseen is not None:
            require_signals(unseen, step.result.model)
            compared = compare(step.result.model, unseen)
            other = (compared.rotations if rotations else compared.lengths).rms * factor
            repeats = noise_by_file(unseen, step.result.model.machine)
            records = tuple(campaign_records(unseen, compared.residual, repeats))
        names = ("µrad", "urad") if rotations else ("µm", "um")
        return cls(step, *names, rms * factor, out * factor, other, records)

    @property
    def line(self) -> str:
        """For people."""
        said = _SAID[self.step.action].format(_what(self.step))
        left = f"{in_digits(self.rms)} {self.unit} rms"
        text = f"{said}: {left}, left-out blocks {in_digits(self.held_out)}"
        return (
            text if self.unseen is None else f"{text}, held-out campaigns {in_digits(self.unseen)}"
        )

    @property
    def as_json(self) -> dict[str, Any]:
        """One entry of ``steps``."""
        effect = self.step.effect
        return {
            "action": self.step.action,
            "spec": None if effect is None else effect.spec,
            "lines": [{"file": s.file, "line": s.line} for s in self.step.strays],
            "unit": self.json_unit,
            "rms": finite(self.rms),
            "left_out_blocks": finite(self.held_out),
            "holdout": None if self.unseen is None else finite(self.unseen),
            "chi2_per_dof": finite(self.step.result.chi2_per_dof),
        }


@dataclass(frozen=True, eq=False)
class ReachedModel:
    """The model that a course of steps reached, written.

    Attributes
    ----------
    course
        From the model as it was to the verdict.
    steps
        The figures of each step.
    model
        The last one.
    held_out
        Campaigns that were never fitted; None without any.
    """

    course: Course
    steps: tuple[StepFigures, ...]
    model: Model
    held_out: HeldOutCampaigns | None

    def as_json(self) -> dict[str, Any]:
        """What ``--apply`` adds to the answer."""
        return {
            "steps": [s.as_json for s in self.steps],
            "holdout_shares": shares(self.held_out),
            "not_kept": [e.spec for e in self.course.refused],
        }


def reach(
    model: Model,
    campaign: Campaign,
    noise: NoiseFloor,
    held_out: HeldOutCampaigns | None,
    out: Path,
    *,
    say: Callable[[str], None],
    progress: Callable[[str], None],
) -> ReachedModel:
    """Go from a model to the verdict, step by step, and write the model that is reached.

    Parameters
    ----------
    model, campaign, noise
        Where to begin, what was measured, and its noise floor.
    held_out
        Campaigns to see the error fall on; None without any.
    out
        The file to write.
    say
        Called with a line for every step, as soon as it is made.
    progress
        Called with a few words at the start of each stage.
    """
    unseen = None if held_out is None else held_out.campaign
    steps: list[StepFigures] = []

    def on_step(step: Step) -> None:
        steps.append(StepFigures.of(step, unseen))
        say(steps[-1].line)

    course = to_the_verdict(model, campaign, on_step=on_step, progress=progress)
    written = write(course, steps, noise, unseen, out)
    return ReachedModel(course, tuple(steps), written, held_out)


def write(
    course: Course,
    steps: Sequence[StepFigures],
    noise: NoiseFloor,
    unseen: Campaign | None,
    out: Path,
) -> Model:
    """Write the model that was reached; every step stands in its history."""
    lengths = noise.lengths
    first = course.steps[0].result.problem
    record: dict[str, Any] = {
        "date": now(),
        "version": abbe_version(),
        "noise_floor": None if lengths is None else lengths.value,
        "noise_floor_rotation": noise.value("rotation"),
        "noise": noise_by_file(first.campaign, first.model.machine, noise),
    }
    model = first.model
    for one in steps:
        step = one.step
        kept = recorded(step.result, model, **record)
        extra: dict[str, Any] = {}
        if step.effect is not None:
            extra["removed" if step.action == "removed" else "added"] = step.effect.spec
        if unseen is not None and one.unseen is not None and not math.isnan(one.unseen):
            if one.json_unit == "um":
                extra["holdout_rms"] = one.unseen
            extra["holdout"] = [dict(r) for r in one.unseen_records]
        model = replace(kept, fit={**kept.fit, **extra})
    save_model(model, out)
    return model


def as_text(course: Course, model: Model) -> Iterator[str]:
    """What was refused, and the model that was reached."""
    for effect in course.refused:
        yield f"not kept, left-out blocks are not predicted better with it: {effect.spec}"
    units = _units(course)
    for term in model.terms:
        if size := _shape(course, model, term):
            yield f"  {term.effect.spec}: {size}"
            continue
        shown = []
        for name, value in list(term.values.items())[:5]:
            if not value.measured:
                shown.append(f"{name} not measured")
                continue
            unit, factor = units[term.effect.spec][name]
            sd = (value.sd or 0.0) * factor
            if sd < _NOTHING:
                shown.append(f"{name} = {_plain(value.value * factor)} {unit}, by convention")
                continue
            shown.append(f"{name} = {with_uncertainty(value.value * factor, sd)} {unit}")
        more = len(term.values) - len(shown)
        yield f"  {term.effect.spec}: {', '.join(shown)}" + (f" and {more} more" if more else "")
        nonlinear = term.nonlinear(model.machine)
        conditions = course.last.result.problem.campaign.conditions
        for words in hidden_waves(term.effect, nonlinear, model.machine, conditions):
            yield f"    {words}"


def _shape(course: Course, model: Model, term: Term) -> str:
    """An error motion of many coefficients by what its curve shows; empty for what is none."""
    axis = getattr(term.effect, "axis", None)
    at = course.last.result.problem.campaign.conditions.positions.get(axis or "")
    if at is None or len(term.values) <= _SINGLE:
        return ""
    low, high = float(at.min()), float(at.max())
    size = peak_to_valley(term, model.machine, low, high)
    reversal = play(term, model.machine, low, high)
    if size is None and reversal is None:
        return ""
    unit, factor = _units(course)[term.effect.spec][next(iter(term.values))]
    turn, mm = (180.0 / math.pi, "°") if model.machine.axis(axis or "").rotary else (1.0, " mm")
    over = f"{in_digits(low * turn, 4)} … {in_digits(high * turn, 4)}{mm}"
    if reversal is not None:
        least, greatest = (in_digits(b * factor) for b in reversal)
        curve = f"{least} … {greatest} {unit} of play"
    else:
        curve = f"{in_digits((size or 0.0) * factor)} {unit} peak to valley"
    return f"{curve} over {axis} {over}, {len(term.values)} coefficients"


def _units(course: Course) -> dict[str, dict[str, tuple[str, float]]]:
    layout = course.last.result.problem.layout
    effects = course.last.result.problem.model.effects
    return {
        effect.spec: {u.name: read_in(u) for u in layout.unknowns[where]}
        for effect, where in zip(effects, layout.terms, strict=True)
    }


def _plain(value: float) -> str:
    return in_digits(value, 4) if abs(value) > _NOTHING else "0"
