"""Measurements that would lower a task's uncertainty most, among the set-ups that could be made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.knowledge import added, prior, scales
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.candidates import possible
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.virtual_cmm.linear_propagation import LinearPropagation

F64 = NDArray[np.float64]

_WORTH = 0.05
"""Part of the uncertainty that a measurement must take away to be named."""


@dataclass(frozen=True, eq=False)
class LoweringMeasurement:
    """A set-up, and what it would make of the standard uncertainties.

    Attributes
    ----------
    setup
        What to measure.
    before, after
        Standard uncertainties of the characteristics by the law of propagation, shape (c,), mm
        (angles: rad), without and with it; NaN for form and position.
    """

    setup: PlannedSetup
    before: F64
    after: F64

    @property
    def helped(self) -> int:
        """Index of the characteristic that it helps most."""
        part = np.where(self.before > 0.0, self.after / self.before, 1.0)
        return int(np.nanargmin(part))


def lowering(
    model: Model,
    linear: LinearPropagation,
    tool: tuple[float, float, float],
    instruments: Sequence[PlannedInstrument],
) -> Iterator[LoweringMeasurement]:
    """The best set-up of each instrument, the one that lowers most first.

    All characteristics count alike: by the part of their variance that goes.

    Parameters
    ----------
    tool
        Offset of the stylus with which the machine would be measured, mm.
    """
    judged = np.isfinite(linear.sd) & (linear.sd > 0.0)
    if not judged.any():
        return
    with threads_for(0):
        task = SurveyTask(model, tools={"T1": tool})
        covariance = prior(model, changed=0.0)
        slopes = np.zeros((len(linear.sd), len(covariance)))
        fitted = [t.fitted for t in model.terms for _ in _names(t.effect, model)]
        slopes[:, np.flatnonzero(fitted)] = linear.slopes
        slopes *= scales(model)
        found = [
            best
            for one in instruments
            if (best := _best(task, one, slopes, covariance, linear.sd, judged)) is not None
        ]
    yield from sorted(found, key=lambda m: float(np.sum((m.after / m.before)[judged] ** 2)))


def _names(effect: object, model: Model) -> Iterator[str]:
    for p in (*effect.linear(model.machine), *effect.nonlinear(model.machine)):  # type: ignore[attr-defined]
        yield p.name


def _best(
    task: SurveyTask,
    instrument: PlannedInstrument,
    slopes: F64,
    covariance: F64,
    sd: F64,
    judged: NDArray[np.bool_],
) -> LoweringMeasurement | None:
    best: tuple[float, PlannedSetup, F64] | None = None
    for setup in possible(task, [instrument]):
        root = added(task, setup)
        half = slopes @ covariance @ root.T
        inner = np.eye(len(root)) + root @ covariance @ root.T
        falls = np.einsum("ck,kc->c", half, np.linalg.solve(inner, half.T))
        falls = np.minimum(falls, sd**2)
        part = float(np.sum((falls / sd**2)[judged]))
        if best is None or part > best[0]:
            best = (part, setup, falls)
    if best is None:
        return None
    after = np.sqrt(np.maximum(sd**2 - best[2], 0.0))
    if float(np.nanmin(np.where(judged, after / np.where(judged, sd, 1.0), 1.0))) > 1.0 - _WORTH:
        return None
    return LoweringMeasurement(best[1], sd, after)
