"""Sensitivities of the error at the functional point to a model's parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect, Motion
from abbe.compcore.errors import require_type
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.model.model import Model, Term, Value

F64 = NDArray[np.float64]

_MOST_KEPT = 1000
"""Rows of which effects' motions are kept: fit after fit asks for the same few places."""


def sensitivities(model: Model, conditions: Conditions) -> tuple[F64, F64]:
    """Derivatives of the first-order error by the parameters of all fitted effects.

    Effects of the instrument do not move the machine; their derivatives are zero, except for those
    that amend a reading which the machine's effects use.

    Returns
    -------
    translation
        Shape (n, 3, p), mm per unit of parameter, machine axes; parameters term by term, linear
        ones then non-linear ones, as in `Model.covariance`.
    rotation
        Shape (n, 3, p), rad per unit of parameter.
    """
    conditions = model.amended(conditions)
    chain = Chain.of(model.machine, conditions)
    size = sum(len(term.values) for term in model.terms)
    translation = np.zeros((conditions.n, 3, size))
    rotation = np.zeros((conditions.n, 3, size))
    at = 0
    for term in model.terms:
        count = len(term.values)
        if count and (term.effect.scope != "instrument" or term.effect.reads_model):
            where = slice(at, at + count)
            _add_term(model, term, chain, translation[:, :, where], rotation[:, :, where])
        at += count
    return translation, rotation


def _add_term(model: Model, term: Term, chain: Chain, translation: F64, rotation: F64) -> None:
    machine, effect = model.machine, term.effect
    linear = len(effect.linear(machine))
    for motion in _motions(model, term, chain.conditions):
        _add(chain, motion, translation, rotation, motion.parameters)
    coefficients = term.coefficients(machine)
    for j, parameter in enumerate(effect.nonlinear(machine)):
        if not parameter.smooth:
            continue
        here = term.values[parameter.name].value
        step = 1e-4 * max(abs(here), 1e-3 * (parameter.bounds[1] - parameter.bounds[0]))
        for sign in (1.0, -1.0):
            moved = {**term.values, parameter.name: Value(here + sign * step)}
            for motion in _motions(model, replace(term, values=moved), chain.conditions):
                value = motion.amount(coefficients)
                slope = Motion(motion.error_motion, (sign / (2.0 * step) * value)[:, None])
                _add(chain, slope, translation, rotation, slice(linear + j, linear + j + 1))


def _motions(model: Model, term: Term, conditions: Conditions) -> tuple[Motion, ...]:
    effect: Effect = term.effect
    nonlinear = term.nonlinear(model.machine)
    if effect.reads_model:
        fitted = [other for other in model.terms if other.fitted]
        return effect.motions_among(model.machine, conditions, nonlinear, fitted)
    if nonlinear or conditions.n > _MOST_KEPT:
        return effect.motions(model.machine, conditions, nonlinear)
    # what is kept holds the machine, so that its id stays its own
    machine = model.machine
    key = ("motions", effect, id(machine))
    made = conditions.kept(key, lambda: (machine, effect.motions(machine, conditions, nonlinear)))
    return made[1]


def _add(chain: Chain, motion: Motion, translation: F64, rotation: F64, where: slice) -> None:
    moved, turned = chain.influence(motion.error_motion)
    translation[:, :, where] += moved[:, :, None] * motion.columns[:, None, :]
    if motion.error_motion.rotation:
        rotation[:, :, where] += turned[:, :, None] * motion.columns[:, None, :]


def covariance_root(covariance: F64) -> F64:
    """A matrix R with ``R Rᵀ`` = the covariance, (p, p), for many predictions of one model."""
    # mm, rad and 1/K differ by orders of magnitude: decompose the correlations
    sd = np.sqrt(np.diag(covariance))
    unit = np.where(sd > 0.0, sd, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def prediction_sd(model: Model, conditions: Conditions, root: F64 | None = None) -> tuple[F64, F64]:
    """Standard uncertainty of a model's predicted error, from the fit's covariance.

    What the campaign did not determine counts with the width of its plausible range, so that a
    prediction which needs it is honestly uncertain, and one that does not is unaffected. The
    reference frame is a convention and has no uncertainty.

    Parameters
    ----------
    model
        A fitted model with its covariance.
    conditions
        The n rows at which it predicts.
    root
        `covariance_root` of the model's covariance, where it is known already.

    Returns
    -------
    translation, rotation
        Of the error of the functional point (n, 3), mm, and of the orientation (n, 3), rad.

    Raises
    ------
    ValueError
        When the model has no covariance.
    """
    require_type(model, Model, "model")
    require_type(conditions, Conditions, "conditions")
    if model.covariance is None:
        raise ValueError("the model has no covariance; fit it first")
    size = model.covariance.shape[0]
    half = covariance_root(model.covariance) if root is None else root
    translation, rotation = np.zeros((conditions.n, 3)), np.zeros((conditions.n, 3))
    most = max(1, 4_000_000 // (3 * max(size, 1)))
    for at in range(0, conditions.n, most):
        rows = slice(at, at + most)
        moved, turned = sensitivities(model, conditions.rows(rows))
        translation[rows] = np.sqrt(((moved @ half) ** 2).sum(axis=2))
        rotation[rows] = np.sqrt(((turned @ half) ** 2).sum(axis=2))
    return translation, rotation
