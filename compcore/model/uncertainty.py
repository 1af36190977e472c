"""Uncertainty of a prediction (ISO/TR 16907, 11.1), inside and outside of what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import prediction_sd

F64 = NDArray[np.float64]

COVERAGE = 2.0
"""The factor k by which ± stands for more than the standard uncertainty: 95 %."""
_RECTANGULAR = 1.0 / np.sqrt(3.0)
_SLACK = 1e-9


@dataclass(frozen=True, slots=True)
class OutsideMeasured:
    """A position, temperature or tool offset outside of the measured range.

    Attributes
    ----------
    name
        An axis, a signal, or ``tool x`` ….
    value
        Where it is, at the row that is farthest out: mm, degrees or the signal's unit.
    low, high, unit
        Where it was when the machine was measured.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        low, high = round(self.low, 3), round(self.high, 3)
        measured = f"at {low:g}" if low == high else f"{low:g} … {high:g}"
        return f"{self.name} = {round(self.value, 3):g}{unit} was not measured ({measured}{unit})"


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
    as the model does. `root`: `sensitivity.covariance_root`, where it is known already.
    """
    if model.covariance is None:
        return None
    moved, turned = prediction_sd(model, conditions, root)
    nearest, beyond = _nearest(model, conditions)
    if beyond:
        here, there = model.predict(conditions), model.predict(nearest)
        change = _RECTANGULAR * (here.translation - there.translation)
        moved = np.hypot(moved, change)
        turned = np.hypot(turned, _RECTANGULAR * (here.rotation - there.rotation))
    return PredictionUncertainty(moved, turned, tuple(beyond))


def extrapolated(model: Model, conditions: Conditions) -> tuple[F64, tuple[OutsideMeasured, ...]]:
    """How much the predicted error changes since the nearest condition that was measured.

    Returns
    -------
    change
        Shape (n, 3), mm: half the width of a rectangular distribution; 0 inside.
    beyond
        What lies outside.
    """
    nearest, beyond = _nearest(model, conditions)
    if not beyond:
        return np.zeros((conditions.n, 3)), ()
    return model.predict(conditions).translation - model.predict(nearest).translation, tuple(beyond)


def _nearest(model: Model, conditions: Conditions) -> tuple[Conditions, list[OutsideMeasured]]:
    """The nearest conditions that were measured, and what had to be moved to get there."""
    beyond: list[OutsideMeasured] = []
    positions = dict(conditions.positions)
    for axis, ends in model.measured_positions.items():
        if axis in positions:
            unit, scale = ("°", 180.0 / np.pi) if is_rotary(axis) else ("mm", 1.0)
            held = _held(axis, positions[axis] * scale, ends, unit, beyond)
            positions[axis] = positions[axis] if held is None else held / scale
    needed = set(model.signals_needed())
    signals = dict(conditions.signals)
    for name, ends in model.measured_signals.items():
        if name in needed and name in signals:
            known = model.machine.signals.get(name)
            held = _held(name, signals[name], ends, known.unit if known else "", beyond)
            signals[name] = signals[name] if held is None else held
    tool = np.array(conditions.tool)
    for k, ends in enumerate(model.measured_tool):
        held = _held(f"tool {'xyz'[k]}", tool[:, k], ends, "mm", beyond)
        tool[:, k] = tool[:, k] if held is None else held
    if not beyond:
        return conditions, beyond
    found = replace(
        conditions, positions=positions, signals=signals, tool=tool, _lags={}, _known=None, _made={}
    )
    return found, beyond


def unmeasured(
    model: Model,
    ranges: Mapping[str, tuple[float, float]],
    signals: Mapping[str, tuple[float, float]] | None = None,
    tool: Sequence[tuple[float, float]] = (),
) -> list[OutsideMeasured]:
    """Positions, temperatures and tools of many points that lie outside of what was measured.

    Parameters
    ----------
    ranges
        Axis → least and greatest position, mm (rotary: rad).
    signals
        Signal → least and greatest, in its unit.
    tool
        Least and greatest of x, y and z of the tool's offset, mm.
    """
    beyond: list[OutsideMeasured] = []
    for axis, ends in model.measured_positions.items():
        if axis in ranges:
            unit, scale = ("°", 180.0 / np.pi) if is_rotary(axis) else ("mm", 1.0)
            _held(axis, np.array(ranges[axis]) * scale, ends, unit, beyond)
    needed = model.signals_needed()
    for name, ends in model.measured_signals.items():
        if name in needed and name in (signals or {}):
            known = model.machine.signals.get(name)
            _held(name, np.array((signals or {})[name]), ends, known.unit if known else "", beyond)
    for k, (mine, ends) in enumerate(zip(tool, model.measured_tool, strict=False)):
        _held(f"tool {'xyz'[k]}", np.array(mine), ends, "mm", beyond)
    return beyond


def outside_names(model: Model, conditions: Conditions) -> list[str]:
    """For each row what of it was not measured, names with a blank between; empty: nothing."""
    columns: list[tuple[str, F64, tuple[float, float]]] = []
    for axis, ends in model.measured_positions.items():
        if axis in conditions.positions:
            scale = 180.0 / np.pi if is_rotary(axis) else 1.0
            columns.append((axis, conditions.position(axis) * scale, ends))
    needed = set(model.signals_needed())
    for name, ends in model.measured_signals.items():
        if name in needed and name in conditions.signals:
            columns.append((name, conditions.signals[name], ends))
    for k, ends in enumerate(model.measured_tool):
        columns.append((f"tool_{'xyz'[k]}", conditions.tool[:, k], ends))
    found = [""] * conditions.n
    for name, values, (low, high) in columns:
        slack = _SLACK * (1.0 + abs(low) + abs(high))
        for row in np.flatnonzero(np.maximum(low - values, values - high) > slack).tolist():
            found[row] = f"{found[row]} {name}".strip()
    return found


def _held(
    name: str, values: F64, ends: tuple[float, float], unit: str, beyond: list[OutsideMeasured]
) -> F64 | None:
    """Values brought into a range; None where they are there already."""
    low, high = ends
    slack = _SLACK * (1.0 + abs(low) + abs(high))
    out = np.maximum(low - values, values - high)
    if not (out > slack).any():
        return None
    beyond.append(OutsideMeasured(name, float(values[int(np.nanargmax(out))]), low, high, unit))
    return np.clip(values, low, high)


UNKNOWN = "± is not known: imported, typed in, or changed since the model was fitted"
"""Said in place of an uncertainty where the model has no covariance."""


def in_words(found: PredictionUncertainty | None) -> Iterator[str]:
    """Warnings about positions, temperatures and tools outside of the measured range."""
    for one in () if found is None else found.beyond:
        yield f"{one}: the ± is wider for it"


def expanded(found: PredictionUncertainty, row: int = 0) -> Mapping[str, float]:
    """Expanded uncertainty (k = 2) of the error at the functional point, one row, mm."""
    return {a: float(COVERAGE * found.translation[row, k]) for k, a in enumerate("XYZ")}
