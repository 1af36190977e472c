"""Error motions of an axis along its travel, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import require_type
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotionCurve:
    """An error motion of an axis along its travel, with standard uncertainty, mm or rad.

    Attributes
    ----------
    error_motion
        The error motion.
    position
        Shape (m,), mm (rotary: rad).
    value, sd
        Shape (m,), mm or rad; sd 0 where the model has no covariance.
    """

    error_motion: ErrorMotion
    position: F64
    value: F64
    sd: F64


def motion_curves(model: Model, axis: str, points: int = 61) -> list[MotionCurve]:
    """The error motions of one axis by a fitted model, translations first.

    At the reference temperature, other signals 0, direction of approach unknown, the other axes in
    the middle of their travels. Evaluated at `points` places along the travel of `axis`.
    """
    require_type(model, Model, "model")
    machine = model.machine
    q = np.linspace(*machine.axis(axis).travel, points)
    positions = {a: np.full(points, machine.axes[a].middle) for a in machine.structure.axes}
    signals = {
        s.name: np.full(points, machine.reference_temperature if s.temperature else 0.0)
        for s in machine.signals.values()
    }
    conditions = model.amended(Conditions({**positions, axis: q}, signals=signals))
    size = sum(len(term.values) for term in model.terms)
    columns: dict[ErrorMotion, F64] = {}
    known: dict[ErrorMotion, F64] = {}
    coefficients = np.zeros(size)
    at = 0
    for term in model.terms:
        if term.fitted and term.effect.scope != "instrument":
            own = term.coefficients(machine)
            coefficients[at : at + len(own)] = own
            for motion in term.effect.motions(machine, conditions, term.nonlinear(machine)):
                if motion.error_motion.place == axis:
                    whole = columns.setdefault(motion.error_motion, np.zeros((points, size)))
                    whole[:, at : at + len(own)][:, motion.parameters] += motion.columns
                    if motion.known is not None:
                        known[motion.error_motion] = (
                            known.get(motion.error_motion, 0.0) + motion.known
                        )
        at += len(term.values)
    curves = []
    for error_motion in sorted(columns, key=lambda c: "XYZABC".index(c.component)):
        matrix = columns[error_motion]
        sd = np.zeros(points)
        if model.covariance is not None:
            variance = np.einsum("np,pq,nq->n", matrix, model.covariance, matrix)
            sd = np.sqrt(np.maximum(variance, 0.0))
        values = matrix @ coefficients + known.get(error_motion, 0.0)
        curves.append(MotionCurve(error_motion, q, values, sd))
    return curves
