"""A cause as it is said in the shop: what the machine does, when, and how much of it is seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from abbe.compcore.effects.base import Effect
from abbe.compcore.units import display

Where = Mapping[str, Any]


def _names(where: Where) -> str:
    """The signals that an effect reads: one, or several and which."""
    several = where.get("signals") or [where.get("signal")]
    return " and ".join(str(s) for s in several if s)


def _side(axis: str) -> str:
    return "from above" if axis[0] in "ZW" else "from the plus side"


def _placed(where: Where) -> str:
    """Who moves: an axis that is named, or the tool in a direction."""
    return str(where.get("axis") or where.get("direction") or "the machine")


def _backlash(w: Where, size: str) -> str:
    return f"{w['axis']} stands {size} elsewhere when it comes {_side(w['axis'])}"


def _tilt(w: Where, size: str) -> str:
    why = "differ" if len(w.get("signals") or ()) == 2 else "changes"
    return f"{w['axis']} leans about {w['about']} when {_names(w)} {why}, {size} at the tool"


def _askew(w: Where, size: str) -> str:
    return f"the line of {w['axis']} leans, or its zero is off: {size}"


_SAID: Mapping[str, Callable[[Where, str], str]] = {
    "positioning": lambda w, s: f"{w['axis']} arrives beside its indicated position, by {s}",
    "scale": lambda w, s: f"{w['axis']} travels too far or too short, {s} at its ends",
    "straightness": lambda w, s: f"{w['axis']} does not run straight: {s} in {w['direction']}",
    "angular": lambda w, s: f"{w['axis']} turns about {w['about']} as it travels, {s}",
    "squareness": lambda w, s: f"{w['axes'][0]} and {w['axes'][1]} are not square: {s}",
    "cyclic": lambda w, s: f"{w['axis']} errs by {s} in a wave that repeats along its travel",
    "backlash": _backlash,
    "reversal_angle": lambda w, s: f"{w['axis']} cocks about {w['about']} when it reverses: {s}",
    "lateral_reversal": lambda w, s: (
        f"{w['axis']} steps aside in {w['direction']} when it reverses: {s}"
    ),
    "two_drives": lambda w, s: f"{w['axis']} yaws as one drive runs ahead of the other: {s}",
    "local_defect": lambda w, s: f"{w['axis']} has a bump in one place of its travel: {s}",
    "rotary_location": lambda w, s: f"the line of {w['axis']} lies elsewhere, or leans: {s}",
    "rotary_positioning": lambda w, s: f"{w['axis']} stops at other angles than it shows: {s}",
    "rotary_radial": lambda w, s: f"{w['axis']} wanders in {w['direction']} while it turns: {s}",
    "rotary_axial": lambda w, s: f"{w['axis']} moves along its own line while it turns: {s}",
    "rotary_tilt": lambda w, s: f"{w['axis']} wobbles about {w['direction']} while it turns: {s}",
    "spindle_squareness": lambda w, s: f"the spindle leans towards {w['direction']}: {s}",
    "cross_angular": lambda w, s: (
        f"{w['axis']} turns about {w['about']} by where {w['by']} stands: {s}"
    ),
    "overhang_sag": lambda w, s: f"{w['by']} sags as it reaches out, {s} in {w['direction']}",
    "load_bending": lambda w, s: f"{w['axis']} bends under the load {_names(w)}: {s}",
    "error_grid": lambda _, s: f"errors measured as a whole, on a grid: {s}",
    "scale_expansion": lambda w, s: f"the scale of {w['axis']} grows with {_names(w)}: {s}",
    "thermal_offset": lambda w, s: f"the tool moves in {w['direction']} with {_names(w)}: {s}",
    "screw_heating": lambda w, s: f"the screw of {w['axis']} grows with {_names(w)}: {s}",
    "thermal_bending": lambda w, s: (
        f"{w['axis']} bends about {w['about']} when {_names(w)} differ: {s}"
    ),
    "thermal_tilt": _tilt,
    "warm_up": lambda w, s: f"{_placed(w)} creeps by {s} after switch-on",
    "drift": lambda w, s: f"{_placed(w)} drifts evenly with time, by {s}",
    "event": lambda w, s: f"{_placed(w)} stands {s} elsewhere from one moment on",
    "feed_lag": lambda w, s: f"{w['axis']} lags behind its feed, by {s}",
    "workpiece_expansion": lambda w, s: f"the workpiece grows with {_names(w)}: {s}",
    "dead_path": lambda w, s: f"the laser's dead path follows {_names(w)}: {s}",
    "air_refraction": lambda w, s: f"the laser's wavelength follows {_names(w)}: {s}",
    "cosine": lambda w, s: f"the beam of {w['setup']} is not parallel to the motion: {s}",
    "instrument_drift": lambda w, s: f"the instrument drifts in {w['setup']}: {s}",
    "length_bias": lambda _, s: f"the instrument adds a constant to each distance: {s}",
    "sensor_offset": lambda w, s: f"the thermometer {w['signal']} reads wrong, worth {s}",
    "sensor_gain": lambda w, s: f"the thermometer {w['signal']} reads differences wrong: {s}",
    "setup_zero": lambda w, s: f"the zero of {w['setup']} is not what was thought: {s}",
    "setup_slope": lambda w, s: f"the reference of {w['setup']} was not aligned: {s}",
    "setup_frame": lambda w, s: f"the set-up {w['setup']} lies elsewhere than thought: {s}",
    "gravity_flexure": lambda w, s: f"what {w['axis']} carries sags as it turns: {s}",
    "setup_scale": lambda w, s: f"the part or artefact of {w['setup']} was warmer than said: {s}",
    "formula": lambda w, s: f"a formula describes what is left in {w['channel']}: {s}",
}

_TWO_SIDES = ("backlash", "reversal_angle", "lateral_reversal")
"""Kinds whose error jumps from side to side: the shop counts the whole jump."""


def in_the_shop(
    effect: Effect, largest: float, unit: str, values: Sequence[tuple[float, str]] = ()
) -> str:
    """What a cause does, in a sentence without the words of the catalogue.

    Parameters
    ----------
    effect
        The cause.
    largest
        The largest error of it that the campaign shows, in `unit`.
    unit
        ``µm`` or ``µrad``.
    values
        Its parameters with their units, inside the code.
    """
    from abbe.compcore.diagnosis.explain import headline

    say = _SAID.get(effect.kind)
    if say is None:
        return headline(effect)
    if effect.kind in _TWO_SIDES:
        largest *= 2.0
        if len(values) == 1:
            unit, factor = display(values[0][1])
            largest = abs(values[0][0]) * factor
    if effect.kind == "rotary_location" and {u for _, u in values} == {"rad"}:
        say = _askew
    text = say(
        effect.where(), f"{largest:.2g} {unit}" if largest < 10.0 else f"{largest:.0f} {unit}"
    )
    return text[0].upper() + text[1:]


def kinds_said() -> frozenset[str]:
    """The kinds that have words of their own."""
    return frozenset(_SAID)
