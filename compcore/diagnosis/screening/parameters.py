"""What the parameters of a candidate would be if it were added, and whether that is plausible."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.evidence import IMPLAUSIBLE
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.effects.base import Effect, NonlinearParameter, Parameter
from abbe.compcore.fitting.determinacy import LEAST_INFORMATION
from abbe.compcore.linalg import svd
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

Columns = Callable[[Mapping[str, float]], F64]

_NO_SURER = 0.99
"""Part of what was believable beforehand above which a standard deviation is no surer than that."""


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
    extent
        Whether it is a place, a period or a path, which people read in mm.
    searched
        Whether it is no coefficient: a period, a lag, a moment, a place.
    """

    name: str
    unit: str
    value: float
    sd: float
    plausible: bool
    range: tuple[float, float]
    description: str
    extent: bool = False
    searched: bool = False

    @property
    def impossible(self) -> bool:
        """Whether it is surely negative where its nature has a sign: a square, an expansion."""
        return self.range[0] == 0.0 and self.value < -2.0 * self.sd

    @property
    def measured(self) -> bool:
        """Whether the campaign says anything of it: makes it surer than its plausible range."""
        return self.sd < _NO_SURER * 0.5 * (self.range[1] - self.range[0])


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
    linear = effect.linear(machine)
    jacobian, _ = with_slopes(columns, basis, effect, chosen, machine)
    smooth = [q for q in nonlinear if q.smooth]
    ranges = [p.plausible for p in linear] + [q.plausible for q in smooth]
    scale = np.array([0.5 * (high - low) for low, high in ranges])
    values, widths = least_norm(basis.project(jacobian), basis.residual, scale, variance)
    # the non-linear ones stand where they were searched; what the slopes would still move is noise
    if smooth:
        count = len(linear)
        values[:count] = least_norm(
            basis.project(jacobian[:, :count]), basis.residual, scale[:count], variance
        )[0]
    width = iter(widths)
    out = [
        _estimate(p, float(value), float(next(width)))
        for p, value in zip(linear, values, strict=False)
    ]
    out += [
        _estimate(q, chosen[q.name], float(next(width)) if q.smooth else 0.0) for q in nonlinear
    ]
    return tuple(out)


def least_norm(projected: F64, residual: F64, scale: F64, variance: float) -> tuple[F64, F64]:
    """Coefficients and their standard deviations, shape (k,) each, in units that can be believed.

    Combinations that the data determine less well than the parameters' plausible ranges do are 0,
    and uncertain by those ranges.

    Parameters
    ----------
    projected, residual
        Columns (n, k) that nothing else imitates, and what is to be explained, (n,).
    scale
        Half of the plausible ranges, shape (k,).
    variance
        Noise variance in units of the weights.
    """
    noise = math.sqrt(variance) if variance > 0.0 else 1.0
    u, s, vt = svd(projected * (scale / noise))
    seen = s > max(LEAST_INFORMATION, 1e-10 * float(s.max(initial=0.0)))
    along = np.where(seen, (u.T @ (residual / noise)) / np.where(seen, s, 1.0), 0.0)
    spread = np.where(seen, 1.0 / np.where(seen, s, 1.0), 1.0)
    unseen = np.maximum(0.0, 1.0 - (vt**2).sum(axis=0))
    square = ((spread[:, None] * vt) ** 2).sum(axis=0) + unseen
    return scale * (vt.T @ along), scale * np.sqrt(square)


def doubt_of(found: Sequence[Estimate]) -> float:
    """What implausible values cost, in units of evidence; 0 where all are plausible.

    A value at a times the edge of its range costs 2·ln(1 + a²) beyond the first doubt: it may be
    a machine that is far out, and never one that is out by any amount.
    """
    doubt = 0.0
    for e in found:
        if not e.plausible:
            half = 0.5 * (e.range[1] - e.range[0])
            beyond = (e.value - 0.5 * (e.range[0] + e.range[1])) / half if half > 0.0 else 1.0
            doubt += 2.0 * math.log1p(beyond**2)
    return doubt + IMPLAUSIBLE if doubt > 0.0 else 0.0


def _estimate(parameter: Parameter | NonlinearParameter, value: float, sd: float) -> Estimate:
    low, high = parameter.plausible
    fits = low - 2.0 * sd <= value <= high + 2.0 * sd
    fits = fits or (isinstance(parameter, Parameter) and parameter.convention)
    return Estimate(
        parameter.name,
        parameter.unit,
        value,
        sd,
        fits,
        parameter.plausible,
        parameter.description,
        parameter.extent,
        isinstance(parameter, NonlinearParameter),
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
