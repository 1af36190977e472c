"""What a turn or a growth is where no lever and no place differs: a shift, the plainest of them."""

from __future__ import annotations

from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import own_component

_TURNS = {
    "positioning": "angular",
    "straightness": "angular",
    "rotary_radial": "rotary_tilt",
    "rotary_axial": "rotary_tilt",
}
"""Shifts of an axis, and the turn of it that says the same to a tool of one length."""

_GROW = ("scale_expansion", "screw_heating")

_BENDS = "load_bending"

WITH_A_LEVER = (*_TURNS.values(), *_GROW, "thermal_tilt", _BENDS)
"""Kinds that are a shift where no lever, or no place, differs."""


def shift_of(shift: Effect, other: Effect) -> bool:
    """Whether one is the shift that another effect is where no lever and no place differs.

    Of an axis's turn its error motion across. Of what grows or leans by signals the shift by the
    same signals, behind a lag both or none: of a growth along its axis, of a lean across. Of a
    guideway that a load twists one that it bends across.
    """
    if shift.kind == _BENDS:
        return other.kind == _BENDS and _across(shift, other)
    if other.kind not in WITH_A_LEVER:
        return False
    if shift.kind != "thermal_offset":
        same_axis = getattr(shift, "axis", None) == getattr(other, "axis", "")
        return _TURNS.get(shift.kind) == other.kind and same_axis
    lags = [getattr(e, "tau", None) is not None for e in (shift, other)]
    if lags[0] != lags[1] or shift.signals_needed() != other.signals_needed():
        return False
    along = getattr(shift, "direction", "")
    if grows(other):
        return own_component(getattr(other, "axis", "")) == along
    return other.kind == "thermal_tilt" and getattr(other, "about", "") != along


def _across(shift: Effect, other: Effect) -> bool:
    """Whether one bends a guideway across the axis about which the other, by its signal, twists."""
    alike = shift.signals_needed() == other.signals_needed()
    same_axis = getattr(shift, "axis", None) == getattr(other, "axis", "")
    along, about = getattr(shift, "direction", None), getattr(other, "about", None)
    return alike and same_axis and along is not None and about not in (None, along)


def grows(effect: Effect) -> bool:
    """Whether an effect grows along an axis, from where that axis has its zero or its bearing."""
    return effect.kind in _GROW
