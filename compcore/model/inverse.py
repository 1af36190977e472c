"""Inversion of a correction: the indicated position for a given actual position.

One equation serves both uses, ``x + error(x) = y``:

* a CMM's corrected reading y back to the raw reading x;
* a CNC's target y to the position x that must be commanded to reach it.

The map ``x → y − error(x)`` is a contraction where the error field's slope is below 1 (it is some
1e-4 on real machines), so the equation has one solution and fixed-point iteration finds it
(Banach): each round multiplies the distance to the solution by at most the contraction factor.
Nothing is linearised, so a table's kinks do no harm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import NotContractionError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]
ErrorField = Callable[[F64], F64]
"""Positions (n, k) → error of the first m of them, (n, m), mm: of X, Y and Z, as far as the
machine has them."""

_STEP = 1e-3
"""mm: step of the differences from which slopes are estimated; far above rounding, below nodes."""
_RUNAWAY = 1e6
"""mm: no machine is a kilometre long."""


@dataclass(frozen=True, eq=False)
class Inverse:
    """Solution of ``x + error(x) = y`` at n points, with the rounds and the contraction factor.

    Attributes
    ----------
    positions
        x, shape (n, k); columns beyond the first m as given.
    error
        error(x), shape (n, m), mm.
    contraction
        Estimated factor by which a round of iteration shrinks the distance to the solution, shape
        (n,): the greatest slope of the error found at the solution and on the way there, unit-free.
    iterations
        Rounds that the slowest point needed.
    """

    positions: F64
    error: F64
    contraction: F64
    iterations: int


def invert(
    error: ErrorField,
    target: F64,
    *,
    tolerance: float = 1e-10,
    rounds: int = 400,
    letters: Sequence[str] = ("X", "Y", "Z"),
) -> Inverse:
    """Solve ``x + error(x) = target`` by fixed-point iteration.

    Parameters
    ----------
    error
        The error field: positions (n, k) in mm (columns beyond `letters`: whatever it reads, e.g.
        rotary positions in rad) → error (n, m), mm. It is asked at n points at a time, always the
        same rows.
    target
        Shape (n, k): those of `letters` in mm first; further columns are held.
    tolerance
        mm: greatest distance of the returned x from the solution.
    rounds
        Greatest number of iterations: 400 reach 1e-10 mm from 5 mm at a factor of 0.94; real
        machines need three.
    letters
        Names of the m axes that move, for what is said.

    Raises
    ------
    NotContractionError
        Where the error's slope reaches 1, so that there may be no solution, or several; names the
        point and the factor.
    """
    x = np.array(target, dtype=np.float64)
    if not len(x):
        return Inverse(x, np.zeros((0, len(letters))), np.zeros(0), 0)
    m = len(letters)
    e = error(x)
    factor = np.zeros(len(x))
    step = np.linalg.norm(e, axis=1)
    count = 0
    while True:
        moved = x.copy()
        moved[:, :m] = target[:, :m] - e
        count += 1
        before, step = step, np.linalg.norm(moved[:, :m] - x[:, :m], axis=1)
        if count > 1:
            large = before > 1e3 * tolerance  # below, rounding makes ratios meaningless
            factor[large] = np.maximum(factor[large], step[large] / before[large])
        x = moved
        e = error(x)
        # Banach: the solution is within q/(1 − q)·step; the residual bounds it as well
        residual = np.linalg.norm(x[:, :m] + e - target[:, :m], axis=1)
        if (residual <= tolerance * np.maximum(1.0 - factor, 1e-3)).all():
            break
        if count == rounds or not np.isfinite(e).all() or step.max() > _RUNAWAY:
            raise _diverged(target, np.maximum(factor, _slopes(error, x, e)), letters)
    factor = np.maximum(factor, _slopes(error, x, e))
    if (factor >= 1.0).any():
        raise _diverged(target, factor, letters)
    return Inverse(x, e, factor, count)


def _slopes(error: ErrorField, x: F64, e: F64) -> F64:
    """Greatest slope of the error at each point, either side of kinks, shape (n,)."""
    worst, m = np.zeros(len(x)), e.shape[1]
    for sign in (1.0, -1.0):
        jacobian = np.empty((len(x), m, m))
        for k in range(m):
            near = x.copy()
            near[:, k] += sign * _STEP
            jacobian[:, :, k] = (error(near) - e) / (sign * _STEP)
        finite = np.isfinite(jacobian).all(axis=(1, 2))
        jacobian[~finite] = 0.0
        size = np.linalg.norm(jacobian, ord=2, axis=(1, 2))
        worst = np.maximum(worst, np.where(finite, size, np.inf))
    return worst


def _diverged(target: F64, factor: F64, letters: Sequence[str]) -> NotContractionError:
    row = int(np.argmax(factor))
    where = ", ".join(f"{a}={v:g}" for a, v in zip(letters, target[row], strict=False))
    return NotContractionError(
        f"the correction cannot be undone at {where}: the error changes by "
        f"{in_digits(factor[row])} mm "
        "per mm of travel, which must stay well below 1; look for a wrong unit"
    )


def invert_model(
    model: Model, target: Conditions, *, tolerance: float = 1e-10
) -> tuple[Conditions, Inverse]:
    """Conditions at whose indicated positions the machine really is at the target, mm (rotary:
    rad).

    Parameters
    ----------
    model
        The model; its error counts as moves of X, Y and Z (`Model.axis_error`).
    target
        Where the functional point is (a corrected reading) or is to be (a CNC's target), with the
        tool, temperatures and whatever else the effects read.
    tolerance
        mm.

    Raises
    ------
    NotContractionError
        As `invert`.
    """

    def error(positions: F64) -> F64:
        moved = {a: positions[:, k] - target.position(a) for k, a in enumerate(letters)}
        found = model.axis_error(target.moved(moved))
        return np.stack([found[a] for a in letters], axis=1)

    letters = model.machine.structure.carrying
    start = np.stack([target.position(a) for a in letters], axis=1)
    solved = invert(error, start, tolerance=tolerance, letters=letters)
    offset = {a: solved.positions[:, k] - target.position(a) for k, a in enumerate(letters)}
    return target.moved(offset), solved
