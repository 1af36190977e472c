"""Rigid-body test (ISO/TR 16907, 7.4.2): does an error motion depend on another axis's position?

Every error motion of every linear axis that the model has is tested with products of low Legendre
polynomials of its own position and of each other axis's. The test is exact (added variables against
the whole fit, nuisances included), so levers and squareness, which also make an error grow with
another axis's position, do not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.distributions import f_beyond
from abbe.compcore.fitting.solution import Solution
from abbe.compcore.linalg import svd, threads_for
from abbe.compcore.machine.error_motion import INSTRUMENT, ErrorMotion
from abbe.compcore.machine.machine import Axis

F64 = NDArray[np.float64]

OWN_DEGREE = 2
OTHER_DEGREE = 2
_SEEN = 0.02
"""Least part of a column that the fit must leave for it to be seen."""


@dataclass(frozen=True, slots=True)
class Dependence:
    """The test whether one error motion depends on the position of another axis.

    Attributes
    ----------
    motion, by
        ``E_ZX`` and the like; the other axis.
    p_value, adjusted
        Of the F-test that there is no dependence; and times the number of tests made (Bonferroni).
    f, degrees
        The statistic and its numerator degrees of freedom; 0 where the campaign does not show it.
    rms
        Root mean square of what the dependence does to displacements and distances, mm.
    alike
        Dependences that this campaign cannot tell from this one: a bow of X that grows with Y is a
        tilt of Y that depends on X.
    """

    motion: str
    by: str
    p_value: float
    adjusted: float
    f: float
    degrees: int
    rms: float
    alike: tuple[str, ...] = ()


def rigid_body_test(result: Solution) -> list[Dependence]:
    """All rigid-body tests that a campaign allows, most significant first.

    What was not measured in several places of the other axis is left out. A large campaign is
    tested on some of its rows (`abbe.compcore.campaign.thinning`).
    """
    result = result.thin
    with threads_for(result.problem.n * result.problem.layout.size):
        found = [
            _tested(result, error_motion, own, other)
            for error_motion in _motions(result)
            for own, other in _pairs(result, error_motion)
        ]
    seen = [test for test in found if test.degrees]
    adjusted = [
        replace(t, adjusted=min(1.0, t.p_value * len(seen)), alike=_alike(t, seen)) for t in seen
    ]
    return sorted(adjusted, key=lambda t: t.p_value)


def _alike(test: Dependence, others: list[Dependence]) -> tuple[str, ...]:
    return tuple(
        f"{t.motion} on {t.by}"
        for t in others
        if t is not test and t.degrees == test.degrees and math.isclose(t.f, test.f, rel_tol=1e-6)
    )


def _motions(result: Solution) -> list[ErrorMotion]:
    """Error motions of linear axes that the model's effects move."""
    machine = result.problem.model.machine
    found: dict[ErrorMotion, None] = {}
    for i in range(len(result.problem.model.effects)):
        for motion in result.problem.motions(i, result.theta):
            place = motion.error_motion.place
            if place != INSTRUMENT and place in machine.axes and not machine.axes[place].rotary:
                found[motion.error_motion] = None
    return list(found)


def _pairs(result: Solution, error_motion: ErrorMotion) -> Iterator[tuple[Axis, Axis]]:
    machine = result.problem.model.machine
    for name in machine.structure.linear:
        if name != error_motion.place:
            yield machine.axes[error_motion.place], machine.axes[name]


def _tested(result: Solution, error_motion: ErrorMotion, own: Axis, other: Axis) -> Dependence:
    problem = result.problem
    conditions = problem.conditions(result.theta)
    x = (own.clamp(conditions.position(own.name)) - own.middle) / own.half_travel
    y = (other.clamp(conditions.position(other.name)) - other.middle) / other.half_travel
    along = legendre.legvander(x, OWN_DEGREE)
    across = legendre.legvander(y, OTHER_DEGREE)[:, 1:]
    product = (along[:, :, None] * across[:, None, :]).reshape(problem.n, -1)
    seen = problem.tangent(result.theta).sensitivity(error_motion)
    columns = (seen * problem.weight)[:, None] * product
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    nothing = Dependence(str(error_motion), other.name, 1.0, 1.0, 0.0, 0, 0.0)
    if not columns.shape[1]:
        return nothing
    left = result.residualise(columns)
    u, s, _ = svd(left)
    u = u[:, s > _SEEN]
    k = u.shape[1]
    dof = result.dof - k
    if not k or dof <= 0:
        return nothing
    part = u @ (u.T @ result.weighted)
    drop = float(part @ part)
    f = drop / k / ((result.chi2 - drop) / dof)
    lengths = (problem.campaign.kind != Kind.ROTATION) & (problem.weight > 0.0)
    moved = (part * np.where(lengths, problem.sd, 0.0))[lengths]
    rms = float(np.sqrt(np.mean(moved**2))) if moved.size else 0.0
    return Dependence(str(error_motion), other.name, f_beyond(f, k, dof), 1.0, f, k, rms)
