"""Further thermometers of an established warmth: which of several predict best together.

That a direction moves with the temperatures is established once, by the evidence that any cause
needs. *Which* thermometers follow the bodies that move it best is a question of prediction: those
beside it belong to the same cause, and are taken for what they foretell of left-out blocks alone.
Where several read nearly the same, their differences may say what none of them does; so besides
each by itself, all of them together are asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import folds, gain
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.signals import LaggedEffect
from abbe.compcore.machine.machine import Machine

Rows = Sequence[NDArray[np.int64]]

LEAST = 0.02
"""Part of the left-out χ² that further thermometers must remove."""

MOST = 0.5
"""Part of the left-out χ² that the thermometers together must remove where no cause stands."""

_SENSORS = ("signal", "signals", "tau", "tau2", "start")
"""Keys that say which sensors an effect reads and how, not what moves."""


def place(effect: Effect) -> tuple[str, str]:
    """What an effect moves, whichever sensors it reads: its kind, and its other keys."""
    keys = {k: v for k, v in effect.where().items() if k not in _SENSORS}
    return effect.kind, str(sorted(keys.items()))


def of_temperatures(effect: Effect, machine: Machine) -> bool:
    """Whether an effect follows temperatures, and nothing else that is recorded."""
    names = effect.signals_needed()
    known = [machine.signals[n] for n in names if n in machine.signals]
    return bool(known) and effect.scope != "instrument" and all(s.temperature for s in known)


def further_thermometers(diagnosis: Findings, warm: Sequence[Effect]) -> list[list[Effect]]:
    """Effects of further thermometers where warmth is established, best predicting first.

    Parameters
    ----------
    diagnosis
        Of the model as it is.
    warm
        The effects that were established.

    Returns
    -------
    What to add, each entry to be added together; empty where nothing predicts better.
    """
    machine = diagnosis.result.problem.model.machine
    places = {place(e) for e in warm if of_temperatures(e, machine)}
    basis = diagnosis.basis
    rows = folds(diagnosis.result.problem.campaign.conditions)
    before = diagnosis.pool.left_out(basis, rows)
    found: list[tuple[float, list[Effect]]] = []
    for effects, extended in _tried(diagnosis, basis, places):
        better = gain(before, diagnosis.pool.left_out(extended, rows))
        if better > LEAST:
            found.append((better, effects))
    found.sort(key=lambda pair: -pair[0])
    return [effects for _, effects in found]


def warmth_together(diagnosis: Findings) -> list[list[Effect]]:
    """What a spreadsheet's regression on all thermometers would find, where no cause stands.

    A description in products and curves of two temperatures says more than either thermometer, and
    so leaves no cause standing, also where both together, straight, foretell most of what was left
    out. What moves by the largest part of it is named then.

    Returns
    -------
    As `further_thermometers`: offsets in one direction, of all thermometers as they are read.
    """
    machine = diagnosis.result.problem.model.machine
    offsets = [
        f.candidate.effect for f in diagnosis.ranked if f.candidate.effect.kind == "thermal_offset"
    ]
    places = {place(e) for e in offsets if of_temperatures(e, machine)}
    rows = folds(diagnosis.result.problem.campaign.conditions)
    before = diagnosis.pool.left_out(diagnosis.basis, rows)
    found: list[tuple[float, list[Effect]]] = []
    for effects, extended in _tried(diagnosis, diagnosis.basis, places):
        better = gain(before, diagnosis.pool.left_out(extended, rows))
        if better > MOST:
            found.append((better, effects))
    found.sort(key=lambda pair: -pair[0])
    return [effects for _, effects in found]


def _tried(
    diagnosis: Findings, basis: Basis, places: set[tuple[str, str]]
) -> Iterator[tuple[list[Effect], Basis]]:
    """Each further thermometer of a place, and all that are read as they are together."""
    machine = diagnosis.result.problem.model.machine
    beside: dict[tuple[str, str], list[Effect]] = {}
    together: dict[tuple[str, str], Basis] = {}
    for f in diagnosis.ranked:
        effect = f.candidate.effect
        where = place(effect)
        if where not in places or not of_temperatures(effect, machine):
            continue
        refined = diagnosis.pool.refined(basis, f)
        columns = diagnosis.pool.found_columns(refined)
        yield [effect], basis.extended(columns)
        if not (isinstance(effect, LaggedEffect) and effect.tau is not None):
            beside.setdefault(where, []).append(effect)
            together[where] = together.get(where, basis).extended(columns)
    for where, effects in beside.items():
        if len(effects) > 1:
            yield effects, together[where]
