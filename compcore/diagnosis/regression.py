"""What a linear regression on all thermometers says, in place of causes found one by one.

A search that takes one cause after another may end where a plain regression on everything at once
foretells better: differences of two thermometers, found early, stand for what three or four say
together. So the regression is a bound: as effects of the catalogue it takes the place of the
warmth that was found, where it foretells left-out blocks surely better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.candidates import candidates
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import LeftOut, folds
from abbe.compcore.diagnosis.screening.projection.basis import SEEN, Basis
from abbe.compcore.diagnosis.thermometers import of_temperatures
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult

F64 = NDArray[np.float64]

_MOST = 150
"""Columns of a regression: with more, another tool is asked first."""

_DIFFERS = 0.02
"""Least part of a column that those before it do not have: less is a thermometer's own noise."""


def regression(less: FitResult) -> Sequence[Effect]:
    """The thermometers that a linear regression beside a model takes, as effects.

    All that are recorded, each in every direction, and where axes moved as expansions and tilts;
    then without those that left-out blocks are foretold no worse without, the weakest first. So of
    collinear ones few stay.

    Parameters
    ----------
    less
        The model without effects of temperatures, fitted.

    Returns
    -------
    Effects of one parameter each, all of them with values that can be; empty where there are none.
    """
    thin = less.thin
    problem, basis = thin.problem, Basis.of(thin)
    machine = less.model.machine
    kinds = ["thermal_offset"]
    if problem.campaign.coverage().moving:
        kinds += ["scale_expansion", "thermal_tilt"]
    effects: list[Effect] = []
    columns = []
    for c in candidates(less.model, problem.campaign):
        effect = c.effect
        as_read = not c.nonlinear_count and len(effect.signals_needed()) == 1
        if not as_read or effect.kind not in kinds or not of_temperatures(effect, machine):
            continue
        own = problem.effect_columns(effect, {}, thin.theta)
        if own.shape[1] == 1 and np.linalg.norm(basis.project(own)) > SEEN * np.linalg.norm(own):
            effects.append(effect)
            columns.append(own[:, 0])
    if not 0 < len(effects) <= _MOST:
        return []
    # shifts first: what an expansion or a tilt says no better is a shift
    order = sorted(range(len(effects)), key=lambda i: kinds.index(effects[i].kind))
    effects, stacked = _differing(
        basis, [effects[i] for i in order], np.stack(columns, 1)[:, order]
    )
    rows = folds(problem.campaign.conditions)
    projected = basis.project(stacked)
    values = np.linalg.lstsq(projected, basis.residual, rcond=SEEN)[0]
    weakest = np.argsort(np.abs(values) * np.linalg.norm(projected, axis=0))
    size = np.linalg.norm(stacked, axis=0)
    kept = list(range(len(effects)))
    left = LeftOut.of(basis.extended_by(projected, size), rows).chi2
    for i in weakest:
        fewer = [k for k in kept if k != i]
        without = LeftOut.of(basis.extended_by(projected[:, fewer], size[fewer]), rows).chi2
        if without <= left:
            kept, left = fewer, without
    while kept:
        values = np.linalg.lstsq(projected[:, kept], basis.residual, rcond=SEEN)[0]
        ranges = np.array([effects[k].linear(machine)[0].plausible for k in kept])
        beyond = np.maximum(values / ranges[:, 1], values / ranges[:, 0])
        if beyond.max() <= 1.0:
            break
        del kept[int(beyond.argmax())]
    return [effects[k] for k in kept]


def _differing(basis: Basis, effects: Sequence[Effect], columns: F64) -> tuple[list[Effect], F64]:
    """Effects whose columns, (n, k), those before them do not say as well, and these."""
    kept: list[int] = []
    said = np.zeros((len(columns), 0))
    for i, own in enumerate(basis.project(columns).T):
        left = own - said @ (said.T @ own)
        size = float(np.linalg.norm(left))
        if size > _DIFFERS * float(np.linalg.norm(own)):
            kept.append(i)
            said = np.column_stack([said, left / size])
    return [effects[i] for i in kept], columns[:, kept]
