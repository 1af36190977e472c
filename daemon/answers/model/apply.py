"""``abbe diagnose --apply``: every step to the verdict with its error, and the model reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.comparison.compare import compare
from abbe.compcore.comparison.read_again import ReadAgain, read_again
from abbe.compcore.diagnosis.stepwise import Course, Step, UnseenCampaign, to_the_verdict
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.files.model_file import save_model
from abbe.compcore.files.model_toml.campaign_record import campaign_records, noise_by_file
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.model.model import Model
from abbe.compcore.units import in_digits
from abbe.daemon.answers.inputs import now
from abbe.daemon.answers.model.fit import finite, undetermined_json
from abbe.daemon.answers.model.held_out import HeldOutCampaigns, shares
from abbe.daemon.installed import abbe_version

_SAID = {
    "began": "the model as it is",
    "added": "added {0}",
    "added together": "added with the next, as neither says it alone: {0}",
    "added with the others": "added with the other motions of the axes: {0}",
    "lagged": "behind a lag: {0}",
    "second body": "a second body follows the same signal: {0}",
    "began elsewhere": "not in equilibrium at first: {0}",
    "described": "described, not explained: {0}",
    "removed": "taken out again, as the others say it too: {0}",
    "composed": 'angles are too large to add up: composition = "exact" from here on',
    "held near 0": "not all of it was measured; what is hardly shown is held near 0",
    "went back": "the end foretells left-out blocks worse than a step on the way: back to that one",
    "kept from before": "what this campaign does not show stays as earlier ones showed it",
    "set aside": "left out, as nothing measured beside agrees: {0}",
}


def _what(step: Step) -> str:
    """The effect of a step, or the readings."""
    if step.effect is not None:
        return step.effect.spec
    named = [f"{Path(s.file).name}, line {s.line}" for s in step.strays[:_LISTED]]
    more = len(step.strays) - len(named)
    return "; ".join(named) + (f" and {more} more" if more else "")


_LISTED = 3


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
    def what(self) -> str:
        """What was changed, for people."""
        return _SAID[self.step.action].format(_what(self.step))

    @property
    def line(self) -> str:
        """For people."""
        said = self.what
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
    again
        What these leave where the fitted ones were read, too; None where that says nothing.
    """

    course: Course
    steps: tuple[StepFigures, ...]
    model: Model
    held_out: HeldOutCampaigns | None
    again: ReadAgain | None = None

    def as_json(self) -> dict[str, Any]:
        """What ``--apply`` adds to the answer."""
        return {
            "steps": [s.as_json for s in self.steps],
            "holdout_shares": shares(self.held_out),
            "not_kept": [e.spec for e in self.course.refused],
            "refused_by_holdout": [[e.spec for e in s] for s in self.course.spoiling],
            "undetermined": undetermined_json(self.course.last.result),
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

    Raises
    ------
    InputError
        When the held-out campaigns lack a signal that a cause may turn out to read.
    """
    unseen = None if held_out is None else held_out.campaign
    if unseen is not None:
        _require_the_same_signals(unseen, campaign, model)
    steps: list[StepFigures] = []

    def on_step(step: Step) -> None:
        steps.append(StepFigures.of(step, unseen))
        say(steps[-1].line)

    def again(best: Step) -> None:
        one, last = StepFigures.of(best, unseen), steps[-1]
        say(
            f"the held-out campaigns end predicted worse ({in_digits(last.unseen or 0.0)} "
            f"{last.unit}) than on the way ({in_digits(one.unseen or 0.0)} {one.unit}): "
            "once more, and what predicts them worse is refused"
        )
        steps.clear()

    def instead(one: Step, other: Step) -> None:
        first, second = StepFigures.of(one, None), StepFigures.of(other, None)
        say(
            f"one cause after another foretells left-out blocks better "
            f"({in_digits(second.held_out)} {second.unit}) than all motions of the axes at once "
            f"({in_digits(first.held_out)} {first.unit}): this way"
        )
        steps.clear()

    course = to_the_verdict(
        model,
        campaign,
        unseen=None if unseen is None else UnseenCampaign(unseen, compare),
        on_step=on_step,
        again=again,
        instead=instead,
        progress=progress,
    )
    written = write(course, steps, noise, unseen, out)
    last = course.last
    seen = (
        None
        if unseen is None
        else read_again(
            last.result, compare(last.result.model, unseen), rotations=last.of_rotations
        )
    )
    return ReachedModel(course, tuple(steps), written, held_out, seen)


def _require_the_same_signals(unseen: Campaign, fitted: Campaign, model: Model) -> None:
    for signal in fitted.conditions.signals:
        if signal not in model.machine.signals or signal in unseen.conditions.signals:
            continue
        files = unseen.lacking.get(signal) or tuple(unseen.files) or (unseen.name,)
        file, line = unseen.unseen.get(signal, (files[0], None))
        raise InputError(
            "a held-out campaign lacks a signal of the fitted ones, and a cause may read it",
            file=file,
            line=line,
            field=signal,
            found=", ".join(unseen.conditions.signals) or "no signals",
            expected=f"a column '{signal}', or go on without --holdout",
        )


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
