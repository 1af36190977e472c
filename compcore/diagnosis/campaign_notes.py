"""What a campaign by its kind cannot show, said beside a diagnosis: steps, nights, no clock."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from abbe.compcore.campaign.approaches import unsaid_approaches
from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.resolution import of_step, step_of
from abbe.compcore.campaign.steady_thermometers import unsteady_words
from abbe.compcore.diagnosis.findings import Findings, measured_kinds
from abbe.compcore.effects.catalogue.linear.two_drives import LENGTHS
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.extrapolated import extrapolated_words
from abbe.compcore.model.measured_ranges import signals_outside
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import Sentence, listed, said
from abbe.compcore.units import in_digits

_OF_THE_REST = 0.3
"""Part of what is left from which on the steps of readings are worth a word."""

_LIKE_A_LASERS = {"setup_scale", "instrument_drift", "drift"}
"""Causes that a laser's own look like."""

NO_CLOCK = said(
    "the campaign says no times: nothing was looked for that changes with time (drift, warm-up, "
    "an event, a lag, an oscillation)"
)
"""Said of a campaign whose rows say not when they were measured."""


def campaign_notes(diagnosis: Findings) -> Iterator[Sentence]:
    """What the campaign could not show, and how its readings were taken."""
    whole = diagnosis.whole
    campaign = whole.problem.campaign
    out, beyond = signals_outside(whole.problem.model, campaign.conditions)
    if beyond:
        yield extrapolated_words(beyond, float(out.mean()))
    if not campaign.clocked:
        yield NO_CLOCK
    if paused := nights(campaign.conditions):
        yield paused
    if coarse := stepping(diagnosis):
        yield coarse
    yield from unsteady_words(campaign, whole.model.machine)
    if axes := unsaid_approaches(campaign):
        named, columns = listed(axes), listed([f"{axis}_dir" for axis in axes])
        if campaign.clocked:
            yield said(
                "targets of {axes} are read from both sides, and no column says from which "
                "({columns}: 1 towards plus, −1 towards minus): play and reversal were not "
                "looked for",
                axes=named, columns=columns,
            )  # fmt: skip
        else:
            yield said(
                "if the rows are in the order in which they were read, targets of {axes} are read "
                "from both sides, and no column says from which ({columns}: 1 towards "
                "plus, −1 towards minus): play and reversal were not looked for",
                axes=named, columns=columns,
            )  # fmt: skip
    if unstated := instrument_unsaid(diagnosis):
        yield unstated
    yield from not_seen(campaign)
    if unread := undeclared(whole.model.machine, campaign.conditions):
        yield unread
    yield from second_drives(whole.model, campaign.conditions)


def instrument_unsaid(diagnosis: Findings) -> Sentence | None:
    """That nobody said what measured, where a cause was named that a laser's may look like."""
    campaign = diagnosis.whole.problem.campaign
    if any(head.get("instrument") for head in campaign.metadata):
        return None
    named = {e.found.candidate.effect.kind for e in diagnosis.established}
    if not named & _LIKE_A_LASERS:
        return None
    return said(
        "no head says what measured, so nothing was looked for that only a laser does (a beam out "
        'of line, its air, a dead path): where it was one, say instrument = "laser" and ask again'
    )


def second_drives(model: Model, conditions: Conditions) -> Iterator[Sentence]:
    """That a length recorded beside an axis may be its second drive's, which no campaign says."""
    read = {name for effect in model.effects for name in effect.signals_needed()}
    for signal in model.machine.signals.values():
        varies = signal.name in conditions.signals and np.ptp(conditions.signals[signal.name]) > 0.0
        if varies and signal.axis and signal.unit in LENGTHS and signal.name not in read:
            yield said(
                "{signal} is a length beside {axis} that no effect reads: where it is how far the "
                "second drive of {axis} is ahead, two_drives says what the bridge does by it, once "
                "it is told where the drives stand",
                signal=signal.name, axis=signal.axis,
            )  # fmt: skip


def not_seen(campaign: Campaign) -> Iterator[Sentence]:
    """Signals that were not seen in every row: no effect can read them."""
    for signal, (file, line) in campaign.unseen.items():
        yield said(
            "{signal} was not seen in every row ({file}, line {line}), so nothing was looked for "
            "in it: leave such rows out, and ask again",
            signal=signal, file=file, line=line,
        )  # fmt: skip


def undeclared(machine: Machine, conditions: Conditions) -> Sentence | None:
    """Columns that vary and are no signals of the machine: no effect can read them."""
    names = [
        name
        for name, values in conditions.signals.items()
        if name not in machine.signals and np.ptp(values) > 0.0
    ]
    if not names:
        return None
    return said(
        "recorded, but no signals of this machine, so nothing was looked for in them: {names}; a "
        "section [machine.signals.{first}] in the model file declares one",
        names=listed(names),
        first=names[0],
    )


def stepping(diagnosis: Findings) -> Sentence | None:
    """That readings step, where their steps are a good part of what is left."""
    step = step_of(diagnosis.whole.problem.campaign, measured_kinds(diagnosis.whole))
    if of_step(step) < _OF_THE_REST * diagnosis.rms or step == 0.0:
        return None
    unit, _, factor = diagnosis.unit
    return said(
        "the readings come in steps of {step} {unit}: by that alone each is unsure by {sd} {unit}, "
        "and what is smaller was not read",
        step=in_digits(step * factor),
        sd=in_digits(of_step(step) * factor, 2),
        unit=unit,
    )


def nights(conditions: Conditions) -> Sentence | None:
    """That a campaign paused over nights, where it recorded temperatures."""
    if not conditions.signals:
        return None
    runs = np.zeros(1) if conditions.run is None else conditions.run
    count = len(np.unique(conditions.stretches)) - len(np.unique(runs))
    if count < 1:
        return None
    return said(
        "the campaign pauses over nights ({count}, 6 h or more): after each, bodies that warm "
        "begin anew, as warm as their thermometers",
        count=count,
    )
