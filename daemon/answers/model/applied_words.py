"""What ``abbe diagnose --apply`` says at its end: the model it reached, and what was refused."""

from __future__ import annotations

import math
from collections.abc import Iterator

from abbe.compcore.diagnosis.hidden_waves import hidden_waves
from abbe.compcore.diagnosis.stepwise import Course
from abbe.compcore.fitting.cancelling import cancel_lines
from abbe.compcore.fitting.words import run_away_lines, undetermined_lines
from abbe.compcore.model.course import peak_to_valley, play
from abbe.compcore.model.model import Model, Term
from abbe.compcore.model.told import not_told, untold
from abbe.compcore.units import in_digits, read_in, with_uncertainty

_SINGLE = 3
"""Coefficients of a shape that say something one by one."""

_NOTHING = 1e-9
"""µm, µrad: a standard uncertainty below this is none, the value a convention; a curve is none."""


def as_text(course: Course, model: Model) -> Iterator[str]:
    """What was refused, the model that was reached, and what of it the campaign does not show."""
    for effect in course.refused:
        yield f"not kept, {course.why[effect.spec]}: {effect.spec}"
    yield from _refused_by_others(course)
    yield from run_away_lines(model, course.last.result.problem.campaign.conditions)
    yield from cancel_lines(course.last.result)
    units = _units(course)
    for term in model.terms:
        if size := _shape(course, model, term):
            yield f"  {term.effect.spec}: {size}"
            continue
        shown = []
        nothing = untold(term.effect, model.machine)
        for name, value in list(term.values.items())[:5]:
            if not_told(value, nothing.get(name, 0.0)):
                shown.append(f"{name} not measured")
                continue
            unit, factor = units[term.effect.spec][name]
            sd = (value.sd or 0.0) * factor
            if sd == 0.0 or (sd < _NOTHING and unit in ("µm", "µrad")):
                shown.append(f"{name} = {_plain(value.value * factor)} {unit}, by convention")
                continue
            shown.append(f"{name} = {with_uncertainty(value.value * factor, sd)} {unit}")
        more = len(term.values) - len(shown)
        yield f"  {term.effect.spec}: {', '.join(shown)}" + (f" and {more} more" if more else "")
        nonlinear = term.nonlinear(model.machine)
        conditions = course.last.result.problem.campaign.conditions
        for words in hidden_waves(term.effect, nonlinear, model.machine, conditions):
            yield f"    {words}"
    if (caution := course.last.result.caution) is not None:
        yield from caution.words()
    undetermined = course.last.result.undetermined
    yield from undetermined_lines([one for one in undetermined if not one.convention])


def _refused_by_others(course: Course) -> Iterator[str]:
    """What the held-out campaigns refused; of sets that contain another one only that one."""
    if not course.spoiling:
        return
    sets = [frozenset(e.spec for e in effects) for effects in course.spoiling]
    for one, effects in zip(sets, course.spoiling, strict=True):
        if not any(other < one for other in sets):
            names = " with ".join(e.spec for e in effects)
            yield f"not kept, the held-out campaigns are predicted worse with it: {names}"
    yield (
        "what the held-out campaigns refused they no longer test: verify the model with another "
        "campaign"
    )


def still_refused(course: Course) -> str:
    """What the fitted campaigns still ask for and the held-out ones refused; empty for nothing."""
    alone = {effects[0].spec for effects in course.spoiling if len(effects) == 1}
    asked = [e.found.candidate.effect.spec for e in course.diagnosis.established]
    names = [spec for spec in asked if spec in alone]
    if not names:
        return ""
    return (
        f"{', '.join(names)}: the fitted campaigns ask for it, the held-out ones are predicted "
        "worse with it. Measure first what tells; do not add it before you know why."
    )


def _shape(course: Course, model: Model, term: Term) -> str:
    """An error motion of many coefficients by what its curve shows; empty for what is none."""
    axis = getattr(term.effect, "axis", None)
    at = course.last.result.problem.campaign.conditions.positions.get(axis or "")
    if at is None or len(term.values) <= _SINGLE:
        return ""
    low, high = float(at.min()), float(at.max())
    size = peak_to_valley(term, model.machine, low, high)
    reversal = play(term, model.machine, low, high)
    if size is None and reversal is None:
        return ""
    unit, factor = _units(course)[term.effect.spec][next(iter(term.values))]
    turn, mm = (180.0 / math.pi, "°") if model.machine.axis(axis or "").rotary else (1.0, " mm")
    over = f"{in_digits(low * turn, 4)} … {in_digits(high * turn, 4)}{mm}"
    if reversal is not None:
        least, greatest = (in_digits(b * factor) for b in reversal)
        curve = f"{least} … {greatest} {unit} of play"
    elif (size or 0.0) * factor < _NOTHING:
        curve = "not measured"
    else:
        curve = f"{in_digits((size or 0.0) * factor)} {unit} peak to valley"
    return f"{curve} over {axis} {over}, {len(term.values)} coefficients"


def _units(course: Course) -> dict[str, dict[str, tuple[str, float]]]:
    layout = course.last.result.problem.layout
    effects = course.last.result.problem.model.effects
    return {
        effect.spec: {u.name: read_in(u) for u in layout.unknowns[where]}
        for effect, where in zip(effects, layout.terms, strict=True)
    }


def _plain(value: float) -> str:
    return in_digits(value, 4) if abs(value) > _NOTHING else "0"
