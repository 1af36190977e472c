"""Lags of a model: which signals its effects follow slowly, and with what time constants."""

from __future__ import annotations

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model


def lags_of(model: Model) -> tuple[tuple[str, float], ...]:
    """(signal, time constant in s) of every lag that the model's fitted effects read."""
    machine = model.machine
    here = Conditions.at(
        {name: axis.middle for name, axis in machine.axes.items()},
        signals=dict.fromkeys(machine.signals, machine.reference_temperature),
    )
    for term in model.terms:
        if term.fitted and term.effect.scope != "instrument":
            term.effect.motions(machine, here, term.nonlinear(machine))
    return here.lags_computed()
