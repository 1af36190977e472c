"""Uncertainty of a prediction (ISO/TR 16907, 11.1), inside and outside of what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.measured_ranges import OutsideMeasured, nearest
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import prediction_sd

F64 = NDArray[np.float64]

COVERAGE = 2.0
"""The factor k by which ± stands for more than the standard uncertainty: 95 %."""
_RECTANGULAR = 1.0 / np.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class PredictionUncertainty:
    """Standard uncertainty of a prediction at n rows.

    Attributes
    ----------
    translation, rotation
        Of the error of the functional point, (n, 3), mm, and of the orientation, (n, 3), rad,
        machine axes; what lies outside of what was measured included.
    beyond
        What lies outside.
    """

    translation: F64
    rotation: F64
    beyond: tuple[OutsideMeasured, ...]


def uncertainty(
    model: Model, conditions: Conditions, root: F64 | None = None
) -> PredictionUncertainty | None:
    """The standard uncertainty of a fitted model's prediction, mm; None without a covariance.

    Two parts, independent of each other: that of the fitted parameters
    (`sensitivity.prediction_sd`), and, outside of the positions, signals and tools of the campaigns
    that were fitted, the change of the prediction since the nearest condition that was measured,
    as a rectangular distribution of that half width: nobody has seen whether the machine goes on
    as the model does. Where temperatures stand to each other as never before, each effect counts
    for itself where that is more: effects that work against each other were only seen together.
    `root`: `sensitivity.covariance_root`, where it is known already.
    """
    if model.covariance is None:
        return None
    moved, turned = prediction_sd(model, conditions, root)
    near = nearest(model, conditions)
    if near.by_itself is not conditions:
        here, there = model.predict(conditions), model.predict(near.by_itself)
        moved = np.hypot(moved, _RECTANGULAR * (here.translation - there.translation))
        turned = np.hypot(turned, _RECTANGULAR * (here.rotation - there.rotation))
    if near.together is not near.by_itself:
        change, turn = _each_by_itself(model, near.by_itself, near.together)
        moved, turned = (
            np.hypot(moved, _RECTANGULAR * change),
            np.hypot(turned, _RECTANGULAR * turn),
        )
    return PredictionUncertainty(moved, turned, near.beyond)


def _each_by_itself(model: Model, here: Conditions, there: Conditions) -> tuple[F64, F64]:
    """How much a prediction changes, (n, 3), mm and rad: together or effect by effect, the more."""
    ends = model.predict(here), model.predict(there)
    together = (ends[0].translation - ends[1].translation, ends[0].rotation - ends[1].rotation)
    parts = model.parts(here), model.parts(there)
    squares = [np.zeros((here.n, 3)), np.zeros((here.n, 3))]
    for spec, one in parts[0].items():
        for k in (0, 1):
            squares[k] += (one[k] - parts[1][spec][k]) ** 2
    moved, turned = (
        np.maximum(np.abs(whole), np.sqrt(square))
        for whole, square in zip(together, squares, strict=True)
    )
    return moved, turned


def extrapolated(model: Model, conditions: Conditions) -> tuple[F64, tuple[OutsideMeasured, ...]]:
    """How much the predicted error changes since the nearest condition that was measured.

    Returns
    -------
    change
        Shape (n, 3), mm: half the width of a rectangular distribution; 0 inside.
    beyond
        What lies outside.
    """
    near = nearest(model, conditions)
    if not near.beyond:
        return np.zeros((conditions.n, 3)), ()
    there = model.predict(near.together)
    return model.predict(conditions).translation - there.translation, near.beyond


UNKNOWN = "± is not known: imported, typed in, or changed since the model was fitted"
"""Said in place of an uncertainty where the model has no covariance."""


def in_words(found: PredictionUncertainty | None) -> Iterator[str]:
    """Warnings about positions, temperatures and tools outside of the measured range."""
    for one in () if found is None else found.beyond:
        yield f"{one}: the ± is wider for it"


def expanded(found: PredictionUncertainty, row: int = 0) -> Mapping[str, float]:
    """Expanded uncertainty (k = 2) of the error at the functional point, one row, mm."""
    return {a: float(COVERAGE * found.translation[row, k]) for k, a in enumerate("XYZ")}
