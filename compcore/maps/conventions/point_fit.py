"""The rotation point of a map by least squares on the exact composition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.maps.conventions.hypotheses import Hypothesis, lever_axes
from abbe.compcore.maps.conventions.subject import Predictor, Subject
from abbe.compcore.maps.conventions.switched import SwitchedPoints

F64 = NDArray[np.float64]

_STEP = 1.0
"""mm: the correction is almost linear in the rotation point, so a coarse difference is exact."""
_ROUNDS = 4
_SINGULAR = 1e-6


@dataclass(frozen=True)
class PointFit:
    """A rotation point estimated by least squares, with its residual.

    Attributes
    ----------
    position
        Axis → estimate, mm; 0 for a coordinate that the points do not determine.
    sd
        Axis → standard deviation, mm.
    undetermined
        Axes whose coordinate the points do not determine, or that are no lever of anything.
    rms
        What is left with this point, mm.
    """

    position: Mapping[str, float]
    sd: Mapping[str, float]
    undetermined: tuple[str, ...]
    rms: float


def fit_rotation_point(
    subject: Subject,
    points: SwitchedPoints,
    start: Hypothesis,
    predictor: Predictor | None = None,
    held: Mapping[str, float] | None = None,
) -> PointFit:
    """Estimate the rotation point (mm), all else as in a hypothesis, by Gauss–Newton.

    `held` fixes coordinates, axis → mm.
    """
    held = held or {}
    machine = start.convention.on(subject.machine(start.structure))
    axes = lever_axes(machine)
    measured = points.difference * (-1.0 if start.artefact else 1.0)
    noise = max(points.sigma, 1e-6)
    predictor = predictor or subject.at(points.conditions)

    def residual(where: F64) -> F64:
        point = dict(zip(axes, where.tolist(), strict=True))
        convention = replace(start.convention, rotation_point=point)
        return (measured - predictor.correction(start.structure, convention)).reshape(-1)

    begin = {**(start.convention.rotation_point or {}), **held}
    where = np.array([begin.get(a, 0.0) for a in axes])
    open_ = np.array([a not in held for a in axes], dtype=bool)
    free = open_
    covariance = np.zeros((len(axes), len(axes)))
    for _ in range(_ROUNDS if axes else 0):
        left = residual(where)
        jacobian = np.stack(
            [(residual(where + _STEP * e) - left) / _STEP for e in np.eye(len(axes))], axis=1
        )
        # a coordinate that moves the correction by less than the noise per metre is not determined
        free = open_ & (np.linalg.norm(jacobian, axis=0) * 1e3 > noise)
        where = np.where(free | ~open_, where, 0.0)
        if not free.any():
            break
        inverse = np.linalg.pinv(jacobian[:, free], rcond=_SINGULAR)
        where[free] -= inverse @ left
        covariance[np.ix_(free, free)] = inverse @ inverse.T
    left = residual(where)
    scale = max(noise, float(np.sqrt(np.mean(left**2))))
    sd = scale * np.sqrt(np.diag(covariance))
    others = [a for a in machine.structure.linear if a not in axes]
    return PointFit(
        dict(zip(axes, where.tolist(), strict=True)),
        {a: float(s) for a, s, f in zip(axes, sd, free, strict=True) if f},
        (*others, *(a for a, f in zip(axes, free | ~open_, strict=True) if not f)),
        float(np.sqrt(np.mean(left**2))),
    )
