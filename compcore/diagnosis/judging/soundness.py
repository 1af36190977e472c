"""Whether a step towards a model is sound: two lags are two, no value is beyond what can be."""

from __future__ import annotations

import math

import numpy as np

from abbe.compcore.diagnosis.screening.left_out.independence import independent_share
from abbe.compcore.diagnosis.screening.several_waves import one_wave, waves_of
from abbe.compcore.effects import ScaleExpansion
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.model.model import Model

_ABSURD = 10.0
"""Times the plausible range beyond which nothing is that follows a signal or a guideway."""

_OF_A_GUIDEWAY = ("positioning", "straightness", "angular", "cross_angular")

_TOLD = 2.0
"""Standard uncertainties from which on a value is told from 0 (ISO/IEC Guide 98-3, k = 2)."""

_FEW = 4
"""Coefficients up to which each says something by itself."""

_TWO = 2.0
"""Least ratio of two time constants behind one signal."""


def apart(model: Model, effect: Effect) -> bool:
    """Whether the time constants of two bodies behind one signal are two, or the waves of an axis.

    Of nearly the same two lags the difference is a derivative: it follows noise, and foretells
    nothing. Two waves of nearly the same period are one that grows.
    """
    values = next((t.values for t in model.terms if t.effect == effect), {})
    if "period" in values and any(
        one_wave(effect, model, values["period"].value, other) for other in waves_of(model, effect)
    ):
        return False
    if "tau2" not in values or "tau" not in values:
        return True
    one, other = (values[name].value for name in ("tau", "tau2"))
    return max(one, other) > _TWO * min(one, other)


def by_another_thermometer(model: Model, effect: Effect) -> bool:
    """Whether a scale that follows its own thermometer is to expand by another body's as well.

    By that of another axis; and, where its own is one on the scale and not on a screw or a motor,
    by that of a part or of the air: a scale is as warm as it is.
    """
    if not isinstance(effect, ScaleExpansion):
        return False
    machine = model.machine
    others = [machine.signals[s] for s in effect.signals]
    for beside in model.effects:
        if not isinstance(beside, ScaleExpansion) or beside.axis != effect.axis or beside == effect:
            continue
        own = [machine.signals[s] for s in beside.signals]
        if not all(s.axis == effect.axis for s in own):
            continue
        on_the_scale = all(s.role == "scale" for s in own)
        if any(s.axis != effect.axis and (s.axis is not None or on_the_scale) for s in others):
            return True
    return False


def comes(result: FitResult, effect: Effect) -> bool:
    """Whether what lags behind a signal comes within the time that was measured.

    Behind a longer lag any signal is a ramp, and says nothing of another day. A lag that is longer
    by less than its standard uncertainty is not known to be.
    """
    values = next((t.values for t in result.model.terms if t.effect == effect), {})
    if "tau" not in values or not effect.signals_needed():
        return True
    shortest = values["tau"].value - (values["tau"].sd or 0.0)
    return shortest <= result.problem.campaign.coverage().duration


def sound(model: Model, effect: Effect) -> bool:
    """Whether an accused thermometer reads as wrong as one may, and a beam sags as far as one may.

    What reads wrong by more is described by its reading, and is no fault of the thermometer. Nor is
    a beam what shows in the small difference of a great sag and a guideway that is bent against it.
    """
    values = next((t.values for t in model.terms if t.effect == effect), {})
    if "tau" in values and not values["tau"].measured:
        return False  # so late that it never comes: whatever drifted meanwhile
    if not effect.reads_model and effect.kind != "overhang_sag":
        return True
    for p in effect.linear(model.machine):
        if p.name in values:
            sd = values[p.name].sd or 0.0
            low, high = p.plausible
            if not low - 2.0 * sd <= values[p.name].value <= high + 2.0 * sd:
                return False
    return True


def told_from_nothing(model: Model, effect: Effect) -> bool:
    """Whether one of an effect's coefficients differs from 0 by more than its uncertainty (k = 2).

    Of a shape with many coefficients no single one says anything, so it always is.
    """
    values = next((t.values for t in model.terms if t.effect == effect), {})
    found = [values[p.name] for p in effect.linear(model.machine) if p.name in values]
    if not found or len(found) > _FEW:
        return True
    return any(v.sd is None or abs(v.value) > _TOLD * v.sd for v in found)


def absurd(model: Model, effect: Effect) -> bool:
    """Whether what follows a signal, or a guideway, errs beyond all that machines do.

    Two lags of nearly the same length behind one signal, with coefficients that are each other's
    opposite, are its derivative: they follow whatever drifts meanwhile, and foretell no other day.
    A turn of an axis on a lever that hardly varies, and a shift that is its opposite, likewise.
    """
    if not effect.signals_needed() and effect.kind not in _OF_A_GUIDEWAY:
        return False
    values = next((t.values for t in model.terms if t.effect == effect), {})
    for p in effect.linear(model.machine):
        found = values.get(p.name)
        if found is None:
            continue
        low, high = p.plausible
        beyond = _ABSURD * 0.5 * (high - low)
        if abs(found.value - 0.5 * (low + high)) - 2.0 * (found.sd or 0.0) > beyond:
            return True
    return False


def worth(plainer: FitResult, fuller: FitResult) -> bool:
    """Whether more detail is worth its coefficients, with as many rows as are independent."""
    before, after = plainer.thin, fuller.thin
    share = independent_share(after.weighted, after.problem.campaign.conditions)
    rows = max(2.0, share * after.problem.n)
    weight = after.problem.weight
    was = float(np.sum((before.residual * weight) ** 2))
    more = after.problem.layout.size - before.problem.layout.size
    if was <= 0.0:
        return False  # nothing is left that detail could say
    return after.chi2 <= 0.0 or rows * math.log(was / after.chi2) > more * math.log(rows)
