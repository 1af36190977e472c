"""Thermometers that seem to follow late: an expansion that is negative behind a lag of its signal.

What a body does at once shows behind a thermometer in its housing, or held by tape, as too large an
expansion at once, and a negative one behind a lag. The sum foretells well, and neither is a body.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.signals import LaggedEffect
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import in_digits

_SURE = 2.0
"""Standard uncertainties."""


def shrinks(effect: Effect, machine: Machine, values: Mapping[str, tuple[float, float]]) -> bool:
    """Whether what never is negative, as no expansion is, surely would be.

    `values`: name → value and standard uncertainty of its parameters.
    """
    if not effect.signals_needed():
        return False
    for p in effect.linear(machine):
        low, high = p.plausible
        value, sd = values.get(p.name, (low, 0.0))
        if low > -0.5 * high and value + _SURE * sd < low:
            return True
    return False


def late_words(
    effect: Effect, machine: Machine, values: Mapping[str, tuple[float, float]]
) -> Sentence | None:
    """That a thermometer follows late, of an effect with such values; None of any other."""
    if not isinstance(effect, LaggedEffect) or "tau" not in values:
        return None
    signals = [s for s in effect.signals_needed() if machine.signals[s].temperature]
    if len(signals) != 1 or not shrinks(effect, machine, values):
        return None
    return said(
        "{spec} is negative behind a lag of {tau} s, which no material is: most likely {signal} "
        "follows late what it is fixed to. Look at the thermometer (housing, paste, tape, in air), "
        "not at the machine; as long as it stays so, this and what expands at once foretell "
        "together",
        spec=effect.spec, tau=in_digits(values["tau"][0], 2), signal=signals[0],
    )  # fmt: skip


def late_thermometers(model: Model) -> Iterator[Sentence]:
    """The same of every effect of a fitted model."""
    for term in model.terms:
        values = {name: (v.value, v.sd or 0.0) for name, v in term.values.items()}
        if words := late_words(term.effect, model.machine, values):
            yield words
