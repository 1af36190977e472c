"""Waves that a campaign's even steps cannot tell from others: said where one of them is named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from abbe.compcore.campaign.even_steps import even_steps
from abbe.compcore.campaign.sampling import looks_alike, resolves
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.linear.periodic import LEADS_MM
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import Sentence, listed, said
from abbe.compcore.units import in_digits

_SAME = 2e-3
"""Part of a length within which a wave has a screw's lead."""


def hidden_waves(
    effect: Effect, nonlinear: Mapping[str, float], machine: Machine, conditions: Conditions
) -> Iterator[Sentence]:
    """For each wave of an effect that even steps do not resolve: what else it could be.

    Between the targets such waves differ by all of their amplitude (`campaign.sampling`).
    """
    steps = even_steps(conditions)
    for axis, wave in effect.repeats(machine, nonlinear).items():
        step = steps.get(axis)
        if step is None or machine.axis(axis).rotary or resolves(step, wave):
            continue
        others = [w for w in looks_alike(step, wave, min(LEADS_MM)) if abs(w / wave - 1.0) > _SAME]
        leads = [lead for lead in LEADS_MM if any(abs(w / lead - 1.0) < _SAME for w in others)]
        yield said(
            "{axis} is read every {step} mm, which shows a period of {wave} mm as it shows those "
            "of {others} mm: what lies between the targets is not known. A line along {axis} in "
            "steps of {finer} mm over {length} mm tells; where the screw's lead is known, give it "
            "(period=…).",
            axis=axis,
            step=in_digits(step, 4),
            wave=in_digits(wave, 3),
            others=listed([in_digits(w, 3) for w in leads or others[:3]]),
            finer=in_digits(0.25 * min([wave, *leads]), 2),
            length=in_digits(max([wave, *leads]), 2),
        )
