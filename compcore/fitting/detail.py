"""How much detail of a curve a campaign can show: by the places at which an axis was read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.targets import targets
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.rotary.over_an_arc import RotaryMotion
from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.effects.shapes import CUBIC, Shape
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import WHOLE_TURN, Axis, Machine
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]
E = TypeVar("E", bound=Effect)

_FINEST = 200
_HIGHEST = 20
"""Most coefficients of a spline, highest degree of a polynomial, that are tried."""
_FROM_CONSTANT = ((2, "polynomial:1"), (3, "polynomial:2"), (5, "polynomial:4"))
"""Coefficients and shape of what is tried beyond a value that is the same along an axis."""
_ALIKE = 0.1
"""Places nearer to each other than this part of a curve's own detail show it one place."""
_ACTS = 1e-9
_GRID = 5
"""Points for each coefficient at which a spline is looked at between its places."""
_UNSURE = 2.0
"""Standard deviations of one reading that a curve may be unsure by between them."""


def no_finer_than_seen(effect: E, conditions: Conditions, machine: Machine) -> E:
    """An effect whose spline has fewer coefficients than the campaign shows it places.

    Five targets (ISO 230-2) do not determine eight coefficients: between the targets such a curve
    swings by many times what was read at any of them.
    """
    if not isinstance(effect, ShapedEffect):
        return effect
    match = re.fullmatch(r"spline:(\d+)", effect.shape)
    if match is None or effect.axis not in conditions.positions:
        return effect
    axis, at = machine.axis(effect.axis), np.unique(conditions.position(effect.axis))
    if len(at) < 2:
        return effect
    count = int(match[1])
    while count > 2 and not _shown(count, at, axis):
        count -= 1
    if count == int(match[1]):
        return effect
    return (
        effect.model_copy(update={"shape": f"spline:{count}"}) if count < int(match[1]) else effect
    )


def _shown(count: int, at: F64, axis: Axis) -> bool:
    """Whether a spline of so many coefficients has fewer that act than places show it."""
    places = len(_unlike(count, at, axis))
    if places > count:
        return True
    acting = np.abs(Shape("spline", count).basis(at, axis)).max(axis=0) > _ACTS
    return int(acting.sum()) < places


def _sure_between(count: int, at: F64, axis: Axis) -> bool:
    """Whether a spline is, between the places that show it, about as sure as one reading is.

    Its standard deviation there, in those of one reading at each place: 1 at the most where it has
    far fewer coefficients than places, hundreds where some of its parts lie between two of them.
    """
    if not _shown(count, at, axis):
        return False
    places = _unlike(count, at, axis)
    shape = Shape("spline", count)
    basis = shape.basis(places, axis)
    acting = np.abs(basis).max(axis=0) > _ACTS
    between = np.linspace(places[0], places[-1], _GRID * count)
    _, size, modes = np.linalg.svd(basis[:, acting], full_matrices=False)
    if not size[-1] > _ACTS * size[0]:
        return False
    sds = np.linalg.norm(shape.basis(between, axis)[:, acting] @ (modes.T / size), axis=1)
    return float(sds.max()) <= _UNSURE


def _unlike(count: int, at: F64, axis: Axis) -> F64:
    """The places, ascending, less those that are nearly the same for a spline's detail."""
    low, high = axis.travel
    detail = (high - low) / max(1, count - min(CUBIC, count - 1))
    # of what was read everywhere, as on the way, one place of each small stretch
    _, first = np.unique(np.floor((at - at[0]) / (0.5 * _ALIKE * detail)), return_index=True)
    at = at[first]
    found: list[float] = []
    for place in at:
        if not found or place - found[-1] > _ALIKE * detail:
            found.append(float(place))
    return np.array(found)


def finer(effect: Effect, conditions: Conditions, machine: Machine) -> Iterator[dict[str, object]]:
    """Where-keys with twice the detail, and twice that again, as far as positions show it.

    Where targets were approached again and again, a smooth curve has fewer coefficients than there
    are targets: what it does between them nobody measured. What goes through all of them is a table
    (ISO 230-2), straight lines between, which comes last.

    Of a rotary axis that was not turned around waves of a turn imitate one another with huge
    amplitudes: there a spline of as many coefficients.

    Parameters
    ----------
    effect
        An effect of one axis.
    conditions
        The rows.
    machine
        Its machine.
    """
    if not isinstance(effect, ShapedEffect | RotaryMotion):
        return
    axis = machine.axis(effect.axis)
    at = conditions.position(effect.axis)
    places = targets(conditions, effect.axis, rotary=axis.rotary)
    distinct = len(places) - 1 if len(places) > 1 else len(np.unique(at))
    match = re.fullmatch(r"(spline|polynomial):(\d+)|constant", effect.shape or "")
    if match is not None and match[1]:
        spline, order = match[1] == "spline", int(match[2])
        most = min(distinct, _FINEST if spline else _HIGHEST)
        while order < most:
            before, order = order, min(2 * order, most)
            while spline and order > before and not _sure_between(order, np.unique(at), axis):
                order -= 1
            if order == before:
                break
            yield {"shape": f"{match[1]}:{order}"}
    elif match is not None:
        # what is the same everywhere changes evenly along the axis, before it does so anyhow
        for count, shape in _FROM_CONSTANT:
            if count < distinct:
                yield {"shape": shape}
    elif isinstance(effect, RotaryMotion) and effect.shape is None:
        waves, most = effect.waves, min((distinct - 1) // 2, 32)
        while waves < most:
            waves = min(2 * waves, most)
            if float(np.ptp(at)) >= WHOLE_TURN:
                yield {"harmonics": waves}
            else:
                curve = {"harmonics": None, "shape": f"spline:{2 * waves}"}
                ends = (float(at.min()), float(at.max()))
                held = effect.model_copy(update=curve).held_beyond(axis, ends)
                yield curve | {"within": held.within}
    elif match is None:
        return
    if len(effect.linear(machine)) < len(places) > 1:
        table: dict[str, object] = {} if match else {"harmonics": None}
        shown = np.rad2deg(places) if axis.rotary else places
        if isinstance(effect, RotaryMotion):
            table["within"] = ()  # it holds its ends by itself
        yield table | {"shape": "table", "positions": tuple(float(f"{p:.4f}") for p in shown)}


def reaching(model: Model, campaign: Campaign) -> Model:
    """A model whose error motions of rotary axes are held no nearer than the campaign reads them.

    Where more of a turn is read than a curve was made of, it is fitted to more.
    """
    terms = list(model.terms)
    for i, term in enumerate(terms):
        effect = term.effect
        read = campaign.coverage().ends.get(getattr(effect, "axis", ""))
        if not isinstance(effect, RotaryMotion) or not effect.within or read is None:
            continue
        low, high = (float(e) for e in np.deg2rad(effect.within))
        if read[0] < low or read[1] > high:
            ends = (min(low, read[0]), max(high, read[1]))
            wider = effect.held_beyond(model.machine.axis(effect.axis), ends)
            terms[i] = replace(term, effect=wider)
    return replace(model, terms=tuple(terms)) if terms != list(model.terms) else model
