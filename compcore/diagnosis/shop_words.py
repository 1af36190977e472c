"""A cause as it is said in the shop: what the machine does, when, and how much of it is seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from string import Formatter
from typing import Any

from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import Sentence, listed, said
from abbe.compcore.units import display, in_digits

Where = Mapping[str, Any]


def _signals(where: Where) -> str:
    """The signals that an effect reads: one, or several and which."""
    return listed(where.get("signals") or [where.get("signal") or ""])


def _side(axis: str, upright: str) -> Sentence:
    above = bool(upright) and own_component(axis) == upright and not is_rotary(axis)
    return said("from above") if above else said("from the plus side")


def _who(where: Where) -> str:
    """Who moves: an axis that is named, or the tool in a direction."""
    named = where.get("axis") or where.get("direction")
    return str(named) if named else said("The machine")


SHOP_WORDS: Mapping[str, str] = {
    "positioning": "{axis} arrives beside its indicated position, by {size}",
    "scale": "{axis} travels too far or too short, {size} at its ends",
    "straightness": "{axis} does not run straight: {size} in {direction}",
    "angular": "{axis} turns about {about} as it travels, {size}",
    "squareness": "{first} and {second} are not square: {size}",
    "cyclic": "{axis} errs by {size} in a wave that repeats along its travel",
    "backlash": "{axis} stands {size} elsewhere when it comes {side}",
    "reversal_angle": "{axis} cocks about {about} when it reverses: {size}",
    "lateral_reversal": "{axis} steps aside in {direction} when it reverses: {size}",
    "two_drives": "{axis} yaws as one drive runs ahead of the other: {size}",
    "local_defect": "{axis} has a bump in one place of its travel: {size}",
    "joint": "{axis} steps by {size} at one place of its travel, as at a joint of its scale",
    "rotary_location": "The line of {axis} lies elsewhere, or leans: {size}",
    "rotary_positioning": "{axis} stops at other angles than it shows: {size}",
    "rotary_radial": "{axis} wanders in {direction} while it turns: {size}",
    "rotary_axial": "{axis} moves along its own line while it turns: {size}",
    "rotary_tilt": "{axis} wobbles about {direction} while it turns: {size}",
    "spindle_location": "The pivot length is wrong, or the spindle sits beside the head: {size}",
    "spindle_squareness": "The spindle leans towards {direction}: {size}",
    "cross_angular": "{axis} turns about {about} by where {by} stands: {size}",
    "overhang_sag": "{by} sags as it reaches out, {size} in {direction}",
    "load_bending": "{axis} bends under the load {signals}: {size}",
    "error_grid": "Errors measured as a whole, on a grid: {size}",
    "scale_expansion": "The scale of {axis} grows with {signals}: {size}",
    "thermal_offset": "The tool moves in {direction} with {signals}: {size}",
    "screw_heating": "The screw of {axis} grows with {signals}: {size}",
    "thermal_bending": "{axis} bends about {about} when {signals} differ: {size}",
    "thermal_tilt": "{axis} leans about {about} when {signals} changes, {size} at the tool",
    "warm_up": "{who} creeps by {size} after switch-on",
    "drift": "{who} drifts evenly with time, by {size}",
    "event": "{who} stands {size} elsewhere from one moment on",
    "feed_lag": "{axis} lags behind its feed, by {size}",
    "workpiece_expansion": "The workpiece grows with {signals}: {size}",
    "dead_path": "The laser's dead path follows {signals}: {size}",
    "air_refraction": "The laser's wavelength follows {signals}: {size}",
    "cosine": "The beam of {setup} is not parallel to the motion: {size}",
    "instrument_drift": "The instrument drifts in {setup}: {size}",
    "gauge_expansion": "The gauge expands otherwise than reckoned, by {signals}: {size}",
    "stylus_bending": "The stylus bends as it touches: {size}",
    "probe_lobing": "The probe triggers differently all round: {size}",
    "length_bias": "The instrument adds a constant to each distance: {size}",
    "sensor_offset": "The thermometer {signal} reads wrong, worth {size}",
    "sensor_gain": "The thermometer {signal} reads differences wrong: {size}",
    "sensor_bend": "The thermometer {signal} reads along a curve: {size}",
    "setup_zero": "The zero of {setup} is not what was thought: {size}",
    "setup_slope": "The reference of {setup} was not aligned: {size}",
    "setup_frame": "The set-up {setup} lies elsewhere than thought: {size}",
    "gravity_flexure": "What {axis} carries sags as it turns: {size}",
    "setup_scale": "The part or artefact of {setup} was warmer than said: {size}",
    "formula": "A formula describes what is left in {channel}: {size}",
}
"""Kind of an effect → what it does; `size` is the largest error of it that is seen."""
_TILT_BETWEEN = "{axis} leans about {about} when {signals} differ, {size} at the tool"
_TURNED: Mapping[str, str] = {
    "overhang_sag": "{by} sags as it reaches out: {size}",
    "thermal_tilt": "{axis} leans about {about} when {signals} changes: {size}",
}
"""Likewise where what is seen of it is an angle: it has no place at the tool, and no direction."""
_TURNED_BETWEEN = "{axis} leans about {about} when {signals} differ: {size}"
_UNDER = "{axis} gives way under what {by} carries: {size}"
_JOINTED: Mapping[str, str] = {
    "spindle_location": "The tool sits elsewhere at the last joint than entered: {size}",
}
"""Likewise on an arm, which has no head and no pivot length."""
_ASKEW = "The line of {axis} leans, or its zero is off: {size}"

_TWO_SIDES = ("backlash", "reversal_angle", "lateral_reversal")
"""Kinds whose error jumps from side to side: the shop counts the whole jump."""


def in_the_shop(
    effect: Effect,
    largest: float,
    unit: str,
    values: Sequence[tuple[float, str]] = (),
    upright: str = "Z",
    jointed: bool = False,
) -> Sentence:
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
    upright
        The direction that stands upright (`Structure.upright`).
    jointed
        Whether the machine is an arm (`Structure.jointed`).
    """
    from abbe.compcore.diagnosis.explain import headline

    template = SHOP_WORDS.get(effect.kind)
    if template is None:
        return said("{what}", what=headline(effect))
    if jointed:
        template = _JOINTED.get(effect.kind, template)
    if effect.kind in _TWO_SIDES:
        largest *= 2.0
        if len(values) == 1:
            unit, factor = display(values[0][1])
            largest = abs(values[0][0]) * factor
    where = effect.where()
    if effect.kind == "rotary_location" and {u for _, u in values} == {"rad"}:
        template = _ASKEW
    if effect.kind == "thermal_tilt" and len(where.get("signals") or ()) == 2:
        template = _TURNED_BETWEEN if unit == "µrad" else _TILT_BETWEEN
    elif unit == "µrad":
        template = _TURNED.get(effect.kind, template)
    if effect.kind == "gravity_flexure" and "by" in where:
        template = _UNDER
    first, second = [*(where.get("axes") or ()), "", ""][:2]
    known = {
        **{key: str(value) for key, value in where.items()},
        "size": f"{in_digits(largest, 2)} {unit}" if largest < 10.0 else f"{largest:.0f} {unit}",
        "signals": _signals(where),
        "side": _side(str(where.get("axis") or "X"), upright),
        "who": _who(where),
        "first": str(first),
        "second": str(second),
    }
    needed = {name for _, name, _, _ in Formatter().parse(template) if name}
    return said(template, **{name: known[name] for name in sorted(needed)})


def kinds_said() -> frozenset[str]:
    """The kinds that have words of their own."""
    return frozenset(SHOP_WORDS)


def templates() -> frozenset[str]:
    """Everything that `in_the_shop` may say."""
    others = (_TILT_BETWEEN, *_TURNED.values(), _TURNED_BETWEEN, _UNDER, _ASKEW,
              *_JOINTED.values(), "{what}")  # fmt: skip
    return frozenset([*SHOP_WORDS.values(), *others])
