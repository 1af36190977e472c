"""Further thermometers of an established warmth: which of several predict best together.

That a direction moves with the temperatures is established once, by the evidence that any cause
needs. *Which* thermometers follow the bodies that move it best is a question of prediction: those
beside it belong to the same cause, and are taken for what they foretell of left-out blocks alone;
and so are shifts in the directions in which it moves.
Where several read nearly the same, their differences may say what none of them does; so besides
each by itself, all of them together are asked.

Where no cause is left, whatever a linear regression on thermometers foretells surely is taken
before anything is described (`jointly`). Where they are collinear it takes the fewest that differ:
one after the other, each the one that those before it tell least of.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import LeftOut, folds, gain
from abbe.compcore.diagnosis.screening.pool import WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import SEEN, Basis
from abbe.compcore.diagnosis.uncatalogued.descriptions import LEAST as OF_A_DESCRIPTION
from abbe.compcore.diagnosis.uncatalogued.descriptions import surely
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.signals import LaggedEffect
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]
Rows = Sequence[NDArray[np.int64]]

LEAST = 0.02
"""Part of the left-out χ² that further thermometers must remove."""

MOST = 0.5
"""Part of the left-out χ² that the thermometers together must remove where no cause stands."""

_MOVES = 1e-3
"""Part of the most that an effect moves, from which on a row is moved."""

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
    established = [e for e in warm if of_temperatures(e, machine)]
    places = {place(e) for e in established} | _shifts(diagnosis.result, established)
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


def _shifts(result: FitResult, warm: Sequence[Effect]) -> set[tuple[str, str]]:
    """The places of shifts in the directions in which effects of a fit move what was measured.

    No body begins where its axis has its zero: what grows, turns or bends from elsewhere moves that
    zero too.
    """
    problem = result.problem
    along = problem.campaign.measured_components()
    bent = {t.effect: t.nonlinear(result.model.machine) for t in result.model.terms}
    letters: set[str] = set()
    for effect in warm:
        columns = problem.effect_columns(effect, bent[effect], result.theta)
        size = np.linalg.norm(columns, axis=1)
        letters |= set(along[size > _MOVES * size.max()].tolist())
    return {_offset(letter) for letter in letters & set("XYZ")}


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


@dataclass(frozen=True, eq=False)
class _Together:
    """Thermometers of one place, or of several, beside a model.

    Attributes
    ----------
    effects, columns
        The effects, and their columns, (n, k).
    left
        What the model with them leaves of blocks that are left out.
    """

    effects: list[Effect]
    columns: F64
    left: LeftOut


def jointly(diagnosis: Findings) -> list[Effect]:
    """The thermometers with which a linear regression foretells left-out blocks surely better.

    Nobody is to end worse than with a spreadsheet's regression on everything that was recorded. So
    as much is asked as of a description, and no evidence: it may be that so few rows are
    independent that no thermometer is established by itself, and days foretell each other all the
    same. Asked are as many thermometers of a place as foretell most, those first that differ most;
    and those that a description of what is left is made of.

    Returns
    -------
    The effects of one place, or of all places together, to be added together; empty where nothing
    is foretold surely better, or only by values that no machine has.
    """
    basis, pool = diagnosis.basis, diagnosis.pool
    rows = folds(diagnosis.result.problem.campaign.conditions)
    before = pool.left_out(basis, rows)
    places: dict[tuple[str, str], list[WeighedCandidate]] = {}
    for f in diagnosis.ranked:
        effect = f.candidate.effect
        as_read = f.candidate.nonlinear_count == 0 and len(effect.signals_needed()) == 1
        if as_read and of_temperatures(effect, pool.machine):
            places.setdefault(place(effect), []).append(f)
    groups = [
        [f for f in found if f.candidate.effect.signals_needed()[0] in read]
        for structure in diagnosis.structure
        if (read := set(structure.depends_on)) <= set(pool.machine.signals)
        for where, found in places.items()
        if where == _offset(str(structure.pattern.error_motion)[1:])
    ]
    each = [t for found in groups if (t := _beside(diagnosis, found, rows)) is not None]
    most = [_foretelling_most(diagnosis, found, rows) for found in places.values()]
    better = [t for t in most if t is not None and t.left.chi2 < before.chi2]
    each += better
    if len(better) > 1:
        columns = np.hstack([t.columns for t in better])
        effects = [e for t in better for e in t.effects]
        if _believable(diagnosis, effects, basis.project(columns)):
            each.append(_Together(effects, columns, LeftOut.of(basis.extended(columns), rows)))
    each.sort(key=lambda t: t.left.chi2)
    one = np.ones(len(before.residual))
    for t in each:
        if gain(before, t.left) > OF_A_DESCRIPTION and surely(before, t.left, one):
            return t.effects
    return []


def _offset(direction: str) -> tuple[str, str]:
    """The place of shifts in a direction."""
    return "thermal_offset", str([("direction", direction)])


def _beside(diagnosis: Findings, found: Sequence[WeighedCandidate], rows: Rows) -> _Together | None:
    """Effects beside a model; None where there are none, or values that cannot be."""
    if not found:
        return None
    columns = np.hstack([diagnosis.pool.found_columns(f) for f in found])
    if columns.shape[1] != len(found):
        return None
    return _fitted(diagnosis, found, columns, diagnosis.basis.project(columns), rows)


def _fitted(
    diagnosis: Findings,
    found: Sequence[WeighedCandidate],
    columns: F64,
    projected: F64,
    rows: Rows,
) -> _Together | None:
    """Effects of one parameter each by their columns, (n, k), and what the model leaves of them.

    None where their values cannot be.
    """
    effects = [f.candidate.effect for f in found]
    if not _believable(diagnosis, effects, projected):
        return None
    beside = diagnosis.basis.extended_by(projected, np.linalg.norm(columns, axis=0))
    return _Together(effects, columns, LeftOut.of(beside, rows))


def _foretelling_most(
    diagnosis: Findings, found: Sequence[WeighedCandidate], rows: Rows
) -> _Together | None:
    """Of the thermometers of one place as many as foretell most, those that differ most first."""
    basis = diagnosis.basis
    columns = np.hstack([diagnosis.pool.found_columns(f) for f in found])
    if columns.shape[1] != len(found):
        return None
    left = projected = basis.project(columns)
    whole = np.linalg.norm(columns, axis=0)
    order: list[int] = []
    best: _Together | None = None
    while len(order) < len(found):
        size = np.linalg.norm(left, axis=0)
        most = int(np.argmax(np.where(size > SEEN * whole, size, 0.0)))
        if most in order or size[most] <= SEEN * whole[most]:
            break
        order.append(most)
        direction = left[:, most] / size[most]
        left = left - np.outer(direction, direction @ left)
        tried = [found[i] for i in order]
        beside = _fitted(diagnosis, tried, columns[:, order], projected[:, order], rows)
        if beside is not None and (best is None or beside.left.chi2 < best.left.chi2):
            best = beside
    return best


def _believable(diagnosis: Findings, effects: Sequence[Effect], projected: F64) -> bool:
    """Whether the values that effects of one parameter each would have beside a model can be.

    `projected`: what the model leaves of their columns, (n, k).
    """
    basis, machine = diagnosis.basis, diagnosis.pool.machine
    values = np.linalg.lstsq(projected, basis.residual, rcond=SEEN)[0]
    ranges = np.array([effect.linear(machine)[0].plausible for effect in effects])
    return bool(np.all((ranges[:, 0] <= values) & (values <= ranges[:, 1])))


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
