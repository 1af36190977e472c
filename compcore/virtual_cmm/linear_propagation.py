"""The law of propagation of uncertainty (GUM, 5.1.2) for a part program: derivatives, no draws.

Good where a characteristic is nearly linear in what errs; form and position are not. It tells the
Monte-Carlo's user whether draws were needed, and which measurement would lower what.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.linalg import threads_for
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.sensitivity import sensitivities
from abbe.compcore.virtual_cmm.evaluation import evaluated
from abbe.compcore.virtual_cmm.simulation import VirtualMeasurement

F64 = NDArray[np.float64]

_STEP = 1e-3
"""mm of the differences: far above rounding, far below radii."""
_ROWS = 2000


@dataclass(frozen=True, eq=False)
class LinearPropagation:
    """Standard uncertainty by derivatives.

    Attributes
    ----------
    slopes
        Of each characteristic by the model's parameters, shape (c, p).
    sd
        Of the corrected machine's characteristics, shape (c,), mm (angles: rad); NaN for form and
        position.
    """

    slopes: F64
    sd: F64


def propagated(measurement: VirtualMeasurement) -> LinearPropagation:
    """Propagate all causes to first order; all but the model's parameters are independent."""
    with threads_for(0):
        return _propagated(measurement)


def _propagated(measurement: VirtualMeasurement) -> LinearPropagation:
    machine, program = measurement.machine, measurement.program
    by_points = _by_points(measurement)
    moved, _ = sensitivities(machine.model, machine.middle)
    slopes = -np.einsum("cni,nip->cp", by_points, moved)
    covariance = machine.covariance
    variance = np.einsum("cp,pq,cq->c", slopes, covariance, slopes)
    if machine.change is not None:
        variance += np.einsum("cni,ni->c", by_points, machine.change) ** 2 / 3.0
    for name, state in program.signals.items():
        if state.sd > 0.0:
            up, down = (
                machine.applied.predict(_shifted(machine.middle, name, sign * state.sd)).translation
                for sign in (1.0, -1.0)
            )
            variance += np.einsum("cni,ni->c", by_points, 0.5 * (up - down)) ** 2
    along = np.einsum("cni,ni->cn", by_points, program.normals)
    probe, warmth = program.probe, program.warmth
    variance += (along**2).sum(axis=1) * probe.repeatability**2
    stylus, angles, surface = measurement.touched()
    for k in range(len(program.styli)):
        variance += (along[:, stylus == k].sum(axis=1) * probe.tip) ** 2
    # the lobes' orientation is even: half the square of the third harmonic's amplitude
    harmonic = (along * np.exp(3j * angles)).sum(axis=1)
    variance += 0.5 * np.abs(harmonic) ** 2 * probe.lobing**2
    variance += (along**2 * surface**2).sum(axis=1)
    arms = np.einsum("cni,ni->c", by_points, program.points - program.points.mean(axis=0))
    variance += (arms * warmth.expansion * warmth.temperature_sd) ** 2
    variance += (arms * warmth.expansion_sd * (warmth.temperature - 20.0)) ** 2
    sd = np.sqrt(variance)
    sd[[one.one_sided for one in program.characteristics]] = np.nan
    return LinearPropagation(slopes, sd)


def _by_points(measurement: VirtualMeasurement) -> F64:
    """Derivatives of the characteristics by the measured points, shape (c, n, 3)."""
    points = measurement.program.points
    n = points.size
    found = []
    for first in range(0, n, _ROWS):
        columns = np.arange(first, min(first + _ROWS, n))
        moved = np.zeros((2, len(columns), n))
        moved[0, np.arange(len(columns)), columns] = _STEP
        moved[1] = -moved[0]
        sets = points.reshape(-1) + moved.reshape(-1, n)
        values = evaluated(measurement.program, sets.reshape(-1, *points.shape))
        up, down = values.reshape(2, len(columns), -1)
        found.append((up - down) / (2.0 * _STEP))
    slopes = np.concatenate(found)
    return np.ascontiguousarray(slopes.T).reshape(-1, *points.shape)


def _shifted(conditions: Conditions, name: str, by: float) -> Conditions:
    return conditions.with_offset(name, by)
