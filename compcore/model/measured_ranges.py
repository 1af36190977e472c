"""Where a machine was when it was measured: what lies outside of it, and what was nearest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_SLACK = 1e-9
_READ = 0.2
"""K by which two thermometers that read in tenths may seem to be further apart than they are."""
_CLOSE = 1e-4
"""K within which temperatures stand to each other as they did."""
_STEPS = 40
"""For each pair of thermometers, until their temperatures stand to each other as they did."""


@dataclass(frozen=True, slots=True)
class OutsideMeasured:
    """A position, temperature or tool offset outside of the measured range.

    Attributes
    ----------
    name
        An axis, a signal, ``tool x`` …, or ``T_a − T_b``: two temperatures to each other.
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

    @property
    def by(self) -> float:
        """How far outside it is, in its unit."""
        return max(self.low - self.value, self.value - self.high)

    @property
    def figures(self) -> dict[str, str]:
        """Its name, where it is, and where it was when the machine was measured, with units."""
        unit = f" {self.unit}" if self.unit else ""
        low, high = round(self.low, 3), round(self.high, 3)
        measured = f"at {low:g}" if low == high else f"{low:g} … {high:g}"
        value = f"{round(self.value, 3):g}{unit}"
        return {"name": self.name, "value": value, "measured": f"{measured}{unit}"}

    def __str__(self) -> str:
        figures = self.figures
        return f"{self.name} = {figures['value']} was not measured ({figures['measured']})"


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest conditions that were measured.

    Attributes
    ----------
    by_itself
        Each position, signal and tool offset brought into its own range; the conditions themselves
        where all are inside.
    together
        Temperatures further brought to where they stood to each other; else `by_itself`.
    beyond
        What lay outside; of temperatures to each other first the two that are farthest out, then
        what still is once these are brought back.
    """

    by_itself: Conditions
    together: Conditions
    beyond: tuple[OutsideMeasured, ...]


def nearest(model: Model, conditions: Conditions) -> Nearest:
    """The nearest conditions that were measured, and what had to be moved to get there."""
    beyond: list[OutsideMeasured] = []
    positions = _positions_held(model, conditions, beyond)
    signals = _signals_held(model, conditions, beyond)
    tool = _tool_held(model, conditions, beyond)
    by_itself = conditions
    if beyond:
        by_itself = _elsewhere(conditions, positions=positions, signals=signals, tool=tool)
    stood, apart = _as_they_stood(model, signals)
    together = _elsewhere(by_itself, signals=stood) if apart else by_itself
    return Nearest(by_itself, together, (*beyond, *apart))


def outside(model: Model, conditions: Conditions) -> tuple[OutsideMeasured, ...]:
    """What of positions, tools, temperatures and other signals was not measured."""
    beyond: list[OutsideMeasured] = []
    _positions_held(model, conditions, beyond)
    _tool_held(model, conditions, beyond)
    return (*beyond, *signals_outside(model, conditions, read=0.0)[1])


def signals_outside(
    model: Model, conditions: Conditions, *, read: float = _READ
) -> tuple[NDArray[np.bool_], tuple[OutsideMeasured, ...]]:
    """Rows with signals, by themselves or to each other, that were not measured so, (n,); which.

    Parameters
    ----------
    read
        K by which a single temperature may seem to be outside.
    """
    held: list[OutsideMeasured] = []
    signals = _signals_held(model, conditions, held)
    rows = np.zeros(conditions.n, dtype=bool)
    known = model.machine.signals
    slack = {n: read if n in known and known[n].temperature else 0.0 for n in signals}
    beyond = [one for one in held if one.by > slack[one.name]]
    for name, (low, high) in _needed_ranges(model, signals).items():
        out = _out_by(conditions.signals[name], low, high)
        rows |= out > slack[name] + _slack(low, high)
    for (one, other), (low, high) in _differences(model, signals).items():
        rows |= _out_by(signals[one] - signals[other], low, high) > _CLOSE
    return rows, (*beyond, *_as_they_stood(model, signals)[1])


def farthest(found: Iterable[OutsideMeasured]) -> list[OutsideMeasured]:
    """Of each name the one that is farthest out."""
    kept: dict[str, OutsideMeasured] = {}
    for one in found:
        if one.name not in kept or one.by > kept[one.name].by:
            kept[one.name] = one
    return list(kept.values())


def outside_names(model: Model, conditions: Conditions) -> list[str]:
    """For each row what of it was not measured, names with a blank between; empty: nothing."""
    columns: list[tuple[str, F64, tuple[float, float]]] = []
    for axis, ends in model.measured_positions.items():
        if axis in conditions.positions:
            columns.append((axis, conditions.position(axis) * _unit_of(axis)[1], ends))
    for name, ends in _needed_ranges(model, conditions.signals).items():
        columns.append((name, conditions.signals[name], ends))
    for k, ends in enumerate(model.measured_tool):
        columns.append((f"tool_{'xyz'[k]}", conditions.tool[:, k], ends))
    signals = _signals_held(model, conditions, [])
    for (one, other), ends in _differences(model, signals).items():
        columns.append((f"{one}-{other}", signals[one] - signals[other], ends))
    found = [""] * conditions.n
    for name, values, (low, high) in columns:
        for row in np.flatnonzero(_out_by(values, low, high) > _slack(low, high)).tolist():
            found[row] = f"{found[row]} {name}".strip()
    return found


def _unit_of(axis: str) -> tuple[str, float]:
    return ("°", 180.0 / np.pi) if is_rotary(axis) else ("mm", 1.0)


def _elsewhere(conditions: Conditions, **changed: object) -> Conditions:
    return replace(conditions, **changed, _lags={}, _known=None, _made={})  # type: ignore[arg-type]


def _needed_ranges(model: Model, signals: Mapping[str, object]) -> dict[str, tuple[float, float]]:
    needed = set(model.signals_needed())
    measured = model.measured_signals.items()
    return {name: ends for name, ends in measured if name in needed and name in signals}


def _positions_held(
    model: Model, conditions: Conditions, beyond: list[OutsideMeasured]
) -> dict[str, F64]:
    """The positions, mm or rad, each brought into its own range."""
    positions = dict(conditions.positions)
    for axis, ends in model.measured_positions.items():
        if axis in positions:
            unit, scale = _unit_of(axis)
            held = _held(axis, positions[axis] * scale, ends, unit, beyond)
            positions[axis] = positions[axis] if held is None else held / scale
    return positions


def _tool_held(model: Model, conditions: Conditions, beyond: list[OutsideMeasured]) -> F64:
    """The tool's offset, mm, each component brought into its own range."""
    tool = np.array(conditions.tool)
    for k, ends in enumerate(model.measured_tool):
        held = _held(f"tool {'xyz'[k]}", tool[:, k], ends, "mm", beyond)
        tool[:, k] = tool[:, k] if held is None else held
    return tool


def _signals_held(
    model: Model, conditions: Conditions, beyond: list[OutsideMeasured]
) -> dict[str, F64]:
    """The signals, each brought into its own range."""
    signals = dict(conditions.signals)
    for name, ends in _needed_ranges(model, signals).items():
        known = model.machine.signals.get(name)
        held = _held(name, signals[name], ends, known.unit if known else "", beyond)
        signals[name] = signals[name] if held is None else held
    return signals


def _differences(
    model: Model, signals: Mapping[str, F64]
) -> dict[tuple[str, str], tuple[float, float]]:
    """Pairs of temperatures that the model reads → how far apart they were, with what one reads."""
    needed = set(model.signals_needed()) & set(signals)
    return {
        pair: (low - _READ, high + _READ)
        for pair, (low, high) in model.measured_differences.items()
        if needed.issuperset(pair)
    }


def _as_they_stood(
    model: Model, signals: Mapping[str, F64]
) -> tuple[dict[str, F64], list[OutsideMeasured]]:
    """Temperatures brought to where they stood to each other, and the differences that were not so.

    One pair after another, the one that is farthest out first, half of it each.
    """
    ranges = _differences(model, signals)
    signals = dict(signals)
    if not ranges:
        return signals, []
    names = sorted({name for pair in ranges for name in pair})
    one, other = np.array([[names.index(name) for name in pair] for pair in ranges]).T
    low, high = np.array(list(ranges.values())).T[:, :, None]
    shown = np.array([signals[name] for name in names])
    rows = np.flatnonzero((_out_by(shown[one] - shown[other], low, high) > _CLOSE).any(axis=0))
    if not rows.size:
        return signals, []
    warm = shown[:, rows]
    read = warm[one] - warm[other]
    at_first = _farthest_row(_out_by(read, low, high))
    said: dict[int, OutsideMeasured] = {}
    for _ in range(_STEPS * len(ranges)):
        apart = warm[one] - warm[other]
        far = _farthest_row(_out_by(apart, low, high))
        k = int(far.argmax())
        if far[k] <= _CLOSE:
            break
        if k not in said and at_first[k] > _CLOSE:
            pair, ends = list(ranges)[k], (float(low[k, 0]) + _READ, float(high[k, 0]) - _READ)
            value = float(read[k, int(np.nanargmax(_out_by(read[k], low[k], high[k])))])
            said[k] = OutsideMeasured(" − ".join(pair), value, *ends, "K")
        half = np.nan_to_num(apart[k] - np.clip(apart[k], low[k], high[k])) / 2.0
        warm[one[k]] -= half
        warm[other[k]] += half
    for name, column, brought in zip(names, shown, warm, strict=True):
        column[rows] = brought
        signals[name] = column
    return signals, list(said.values())


def _farthest_row(out: F64) -> F64:
    """Of each pair the row that is farthest out, (pairs,); what is not known is not out."""
    return np.asarray(np.nan_to_num(out, nan=0.0).max(axis=1))


def _out_by(values: F64, low: float | F64, high: float | F64) -> F64:
    """How far values lie outside of a range, negative inside."""
    return np.maximum(low - values, values - high)


def _slack(low: float, high: float) -> float:
    return _SLACK * (1.0 + abs(low) + abs(high))


def _held(
    name: str, values: F64, ends: tuple[float, float], unit: str, beyond: list[OutsideMeasured]
) -> F64 | None:
    """Values brought into a range; None where they are there already."""
    low, high = ends
    out = _out_by(values, low, high)
    if not (out > _slack(low, high)).any():
        return None
    beyond.append(OutsideMeasured(name, float(values[int(np.nanargmax(out))]), low, high, unit))
    return np.clip(values, low, high)
