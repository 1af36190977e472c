"""The answer of ``abbe plan --instruments``: set-ups, times, what is left, as JSON and as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.plan import PlanStep, SurveyPlan
from abbe.compcore.planning.setups.poses import planned_by_joints
from abbe.compcore.planning.setups.presets import PRESETS
from abbe.compcore.sentences import as_it_stands, joined, listed, said
from abbe.compcore.units import in_digits
from abbe.daemon.answers.measurements.plan import BEFORE

MEANING = said(
    "µm: standard uncertainty of the corrected machine's error vector, root of the mean square "
    "over the volume"
)
_NAMED = 3
"""Set-ups hindered by a keep-out box that are named; the page and ``--json`` have all."""
_BY_JOINTS = tuple(INSTRUMENTS[key].title for key in ("laser-tracker", "tracker"))
_MOST_OF_IT = 0.5
"""Part of a machine's usual errors from which on it is said that these set-ups are too few."""


def as_json(plan: SurveyPlan) -> dict[str, Any]:
    """One object for ``--json``."""
    return {
        "machine": plan.task.machine.name,
        "structure": str(plan.task.machine.structure),
        "warm_up_minutes": plan.warm_up / 60.0,
        "hours": plan.seconds / 3600.0,
        "before_um": plan.before * 1e3,
        "after_um": plan.after * 1e3,
        "stays": plan.stays,
        "left_out": list(plan.left_out),
        "placeless": list(plan.placeless),
        "hindered": [
            {"what": one.what, "instrument": one.instrument, "keep_out_box": one.box}
            for one in plan.hindered
        ],
        "setups": [
            {
                "name": step.setup.name,
                "what": step.setup.what,
                "instrument": step.setup.instrument.key,
                "targets": step.setup.count,
                "runs": step.setup.runs,
                "both_ways": step.setup.both_ways,
                "tool": step.setup.tool,
                "minutes": step.setup.seconds / 60.0,
                "before_um": step.before * 1e3,
                "after_um": step.after * 1e3,
            }
            for step in plan.steps
        ],
        "undetermined": [
            {"effects": list(one.effects), "size_um": one.size * 1e3} for one in plan.left
        ],
        "presets_um": None
        if plan.presets is None
        else {name: left * 1e3 for name, left in plan.presets.items()},
    }


def runs_words(step: PlanStep) -> str:
    """``2 × both ways``."""
    setup = step.setup
    ways = said("both ways") if setup.both_ways else said("one way")
    return said("{runs} × {ways}", runs=setup.runs, ways=ways)


def as_text(plan: SurveyPlan) -> Iterator[str]:
    """Lines for people."""
    task = plan.task
    yield said(
        "Plan for {name}, {structure}: {hours} h",
        name=task.machine.name or said("this machine"), structure=task.machine.structure,
        hours=f"{plan.seconds / 3600.0:.1f}",
    )  # fmt: skip
    for line in BEFORE:
        yield said("  before: {what}", what=line)
    yield said(
        "  warm up {minutes} min; after a pause of more than 10 min again",
        minutes=f"{plan.warm_up / 60.0:.0f}",
    )
    yield said("  uncertain beforehand: {size}", size=_microns(plan.before))
    wide = max((len(step.setup.what) for step in plan.steps), default=0)
    tall = max((len(step.setup.name) for step in plan.steps), default=0)
    for step in plan.steps:
        setup = step.setup
        yield said(
            "  {name}  {what}  {count} targets, {runs}  {minutes} min  then {size}",
            name=f"{setup.name:<{tall}}", what=f"{setup.what:<{wide}}", count=f"{setup.count:>3}",
            runs=runs_words(step), minutes=f"{setup.seconds / 60.0:>4.0f}",
            size=_microns(step.after),
        )  # fmt: skip
    yield said("  ({what})", what=MEANING)
    yield from unmoved_words(plan)
    if plan.left_out:
        yield said(
            "  NOT WHOLE: there is no time for {what}; more time, or what the preset is made for "
            "is not shown",
            what=joined(plan.left_out, ", "),
        )
    yield from placeless_words(plan)
    yield from hindered_words(plan)
    yield from _hindered_by_name(plan)
    yield from stays_words(plan)
    for one in plan.left:
        yield said("  undetermined: {what}", what=str(one))
    if plan.presets:
        yield said("  the same time spent otherwise, with the instruments that it needs:")
        for key, left in plan.presets.items():
            title = as_it_stands(PRESETS[key].title)
            yield said("    {what}: {size}", what=title, size=_microns(left))


def unmoved_words(plan: SurveyPlan) -> Iterator[str]:
    """What the figures do not count: directions in which no axis could take an error back."""
    machine = plan.task.machine
    missing = [a for a in "XYZ" if a not in machine.structure.carrying]
    if missing and not machine.structure.rotary:
        yield said(
            "  errors along {axes} are not counted: the machine has no axis that could correct "
            "them",
            axes=listed(missing),
        )


def placeless_words(plan: SurveyPlan) -> Iterator[str]:
    """Instruments at hand that the plan cannot place."""
    for title in plan.placeless:
        if planned_by_joints(plan.task) and title not in _BY_JOINTS:
            yield said(
                "  NO PLACE for {instrument}: it stands or lies where X, Y and Z would lead the "
                "tip to it, or along an axis that the machine does not have; points in space of an "
                "arm are read by a laser tracker or a tracking interferometer",
                instrument=as_it_stands(title),
            )
            continue
        yield said(
            "  NO PLACE for {instrument}: none of its set-ups lies within the travels, keep-out "
            "boxes left out (where rotary axes turn: does the model say where their lines are, "
            "location?)",
            instrument=as_it_stands(title),
        )


def hindered_words(plan: SurveyPlan) -> Iterator[str]:
    """How many set-ups keep-out boxes forbid."""
    if plan.hindered:
        yield said(
            "  KEEP-OUT BOXES: {count} set-ups were not considered, since the tool would enter a "
            "box; with fixtures elsewhere, or a box drawn closer, they may be possible",
            count=len(plan.hindered),
        )


def _hindered_by_name(plan: SurveyPlan) -> Iterator[str]:
    """The first set-ups that keep-out boxes forbid."""
    for one in plan.hindered[:_NAMED]:
        yield said(
            "    {instrument}, {what}: box {box}",
            instrument=as_it_stands(one.instrument), what=as_it_stands(one.what), box=one.box,
        )  # fmt: skip
    if len(plan.hindered) > _NAMED:
        more = len(plan.hindered) - _NAMED
        yield said("    and {count} more (--json and --report name all)", count=more)


def most_stays(plan: SurveyPlan) -> bool:
    """Whether more than half of a machine's usual errors would stay."""
    return plan.stays is not None and plan.stays > _MOST_OF_IT


def stays_words(plan: SurveyPlan) -> Iterator[str]:
    """What of a machine's errors these set-ups do not show, before anything is measured."""
    if plan.stays is None:
        return
    part = f"{100.0 * plan.stays:.0f} %"
    if most_stays(plan):
        yield said(
            "  MOST STAYS: of the errors that a machine usually has some {part} would stay: these "
            "set-ups alone do not show them; more instruments or more time would",
            part=part,
        )  # fmt: skip
    else:
        yield said("  of the errors that a machine usually has some {part} would stay", part=part)


def _microns(value: float) -> str:
    return f"{in_digits(value * 1e3)} µm"
