"""What the axes of every machine have: error motions, squarenesses, places, scales that expand."""

from __future__ import annotations

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.screening.candidates import PLAIN, RIGID, candidates
from abbe.compcore.effects import ScaleExpansion
from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import identity, with_effect

_PLAIN = ("scale", "squareness")
_OF_ALL = {*PLAIN, *RIGID, *_PLAIN, ScaleExpansion.kind}


def of_a_body(effect: Effect, machine: Machine) -> bool:
    """Whether it is an error motion of a linear axis, plain geometry, or its scale's expansion."""
    axis = getattr(effect, "axis", None)
    if isinstance(effect, ScaleExpansion):
        own = all(machine.signals[s].axis == effect.axis for s in effect.signals)
        return own and effect.tau is None
    if effect.kind in RIGID:
        return isinstance(axis, str) and axis in machine.axes and not machine.axis(axis).rotary
    return effect.kind in _PLAIN


def motion(effect: Effect) -> object:
    """What an effect moves, whatever its shape; of a scale's expansion whichever thermometer."""
    return (effect.kind, effect.axis) if isinstance(effect, ScaleExpansion) else identity(effect)


def with_all_motions(model: Model, campaign: Campaign) -> Model:
    """A model, not fitted, with all of these that a campaign could show and the model lacks.

    And with where rotary axes and the tool lie: an arm is drawn by lengths that are mm off.
    """
    known = {motion(e) for e in model.effects}
    missing: dict[object, Effect] = {}
    for effect in (c.effect for c in candidates(model, campaign, _OF_ALL)):
        of_all = effect.kind in PLAIN or of_a_body(effect, model.machine)
        if of_all and motion(effect) not in known:
            missing.setdefault(motion(effect), effect)
    for effect in missing.values():
        model, _ = with_effect(model, effect.kind, effect.where())
    return model
