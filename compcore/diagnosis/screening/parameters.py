"""What the parameters of a candidate would be if it were added, and whether that is plausible."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.screening import Basis
from abbe.compcore.effects.base import Effect, NonlinearParameter, Parameter
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

Columns = Callable[[Mapping[str, float]], F64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter as it would be fitted.

    Attributes
    ----------
    name, unit
        As in the model file; unit inside the code.
    value, sd
        Value and standard deviation, in `unit`.
    plausible
        Whether the value lies, within two standard deviations, in the range of a sound machine.
    range
        That range, in `unit`.
    description
        What the parameter is.
    """

    name: str
    unit: str
    value: float
    sd: float
    plausible: bool
    range: tuple[float, float]
    description: str


def estimates(
    columns: Columns,
    basis: Basis,
    effect: Effect,
    chosen: Mapping[str, float],
    machine: Machine,
    variance: float,
) -> tuple[Estimate, ...]:
    """Parameters of an effect if it joined the model, everything else refitted.

    The linear ones exactly, the non-linear ones with standard deviations from the slopes of the
    columns.

    Parameters
    ----------
    columns
        Non-linear parameters → weighted columns (n, k) of the effect.
    chosen
        The non-linear parameters.
    variance
        Noise variance in units of the weights.
    """
    nonlinear = effect.nonlinear(machine)
    jacobian, coefficients = with_slopes(columns, basis, effect, chosen, machine)
    projected = basis.project(jacobian)
    norms = np.linalg.norm(projected, axis=0)
    safe = np.where(norms > 0.0, norms, 1.0)
    information = np.linalg.pinv((projected / safe).T @ (projected / safe), rcond=1e-10)
    widths = iter(np.sqrt(np.maximum(np.diag(information), 0.0) * variance) / safe)
    out = []
    for p, value in zip(effect.linear(machine), map(float, coefficients), strict=True):
        out.append(_estimate(p, value, float(next(widths))))
    for q in nonlinear:
        width = float(next(widths)) if q.smooth else 0.0
        out.append(_estimate(q, chosen[q.name], width))
    return tuple(out)


def _estimate(parameter: Parameter | NonlinearParameter, value: float, sd: float) -> Estimate:
    low, high = parameter.plausible
    fits = low - 2.0 * sd <= value <= high + 2.0 * sd
    return Estimate(
        parameter.name, parameter.unit, value, sd, fits, parameter.plausible, parameter.description
    )


def neighbours(
    effect: Effect, chosen: Mapping[str, float], machine: Machine
) -> dict[str, tuple[Mapping[str, float], Mapping[str, float]]]:
    """Smooth non-linear parameter → the choices above and below, of which slopes are taken."""
    found: dict[str, tuple[Mapping[str, float], Mapping[str, float]]] = {}
    for p in effect.nonlinear(machine):
        if p.smooth:
            value = chosen[p.name]
            step = 1e-3 * max(abs(value), 1e-6 * (p.bounds[1] - p.bounds[0]), 1e-9)
            above, below = ({**chosen, p.name: value + sign * step} for sign in (1.0, -1.0))
            found[p.name] = above, below
    return found


def with_slopes(
    columns: Columns,
    basis: Basis,
    effect: Effect,
    chosen: Mapping[str, float],
    machine: Machine,
) -> tuple[F64, F64]:
    """Weighted columns of an effect and, behind them, the slopes of what it explains.

    Shape (n, k + number of smooth non-linear parameters); and the linear parameters, shape (k,).
    """
    own = columns(chosen)
    coefficients = np.linalg.lstsq(basis.project(own), basis.residual, rcond=1e-8)[0]
    slopes = [
        ((columns(above) - columns(below)) @ coefficients / (above[name] - below[name]))[:, None]
        for name, (above, below) in neighbours(effect, chosen, machine).items()
    ]
    return np.hstack([own, *slopes]), np.asarray(coefficients, dtype=np.float64)
