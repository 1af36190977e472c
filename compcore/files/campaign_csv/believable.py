"""Plausibility of a campaign's numbers, column by column."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.files.campaign_csv.columns import TOOL, Columns
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.plausible import (
    DISPLACEMENT,
    DISTANCE,
    ROTATION,
    SD_DISPLACEMENT,
    SD_DISTANCE,
    SD_RATIO,
    SD_ROTATION,
    SPINDLE_ANGLE,
    TIME,
    TURNED,
    Range,
    position_range,
    signal_range,
)
from abbe.compcore.machine.plausible import TOOL as TOOL_RANGE
from abbe.compcore.sentences import joined, said

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

_VALUE = {
    Kind.DISPLACEMENT: DISPLACEMENT,
    Kind.ROTATION: ROTATION,
    Kind.DISTANCE: DISTANCE,
    Kind.BASE_DISTANCE: DISTANCE,
}
_KINDS = {
    Kind.DISPLACEMENT: said("displacement"),
    Kind.ROTATION: said("rotation"),
    Kind.DISTANCE: said("distance"),
    Kind.BASE_DISTANCE: said("base distance"),
}
_NOT_BELIEVABLE = said("not believable")
_SD = {
    Kind.DISPLACEMENT: SD_DISPLACEMENT,
    Kind.ROTATION: SD_ROTATION,
    Kind.DISTANCE: SD_DISTANCE,
    Kind.BASE_DISTANCE: SD_DISTANCE,
}


def column_ranges(columns: Columns, machine: Machine) -> dict[str, tuple[Range, str]]:
    """Column of conditions → what it can be, in the file's units, and why, for people."""
    found = {"time": (TIME, "")} if "time" in columns else {}
    for axis, column in columns.positions.items():
        found[column] = (position_range(machine.axes[axis]), travelled(machine.axes[axis]))
    found |= {column: (TOOL_RANGE, "") for column in TOOL if column in columns}
    if columns.spindle:
        found[columns.spindle] = (SPINDLE_ANGLE, "")
    for name in columns.signals:
        signal = machine.signals.get(name)
        role = said("(a signal of role {role})", role=signal.role) if signal else ""
        found[name] = (signal_range(signal), role)
    return found


def travelled(axis: Axis) -> str:
    """Why an axis's positions can only be so, for people."""
    scale = math.degrees(1.0) if axis.rotary else 1.0
    low, high = (end * scale for end in axis.travel)
    return said(
        "(axis {axis} travels from {low} to {high})",
        axis=axis.name, low=f"{low:g}", high=f"{high:g}",
    )  # fmt: skip


def _fahrenheit(values: F64, outside: Mask, allowed: Range) -> str:
    """What to ask where temperatures cannot be °C, and could be °F."""
    if allowed.unit not in ("degC", "°C") or not outside.any():
        return ""
    celsius = (values[np.isfinite(values)] - 32.0) / 1.8
    return "" if allowed.outside(celsius).any() else said("were they recorded in °F?")


def in_words(allowed: Range, why: str, hint: str = "") -> str:
    """What a number can be, why, and what to ask."""
    text: str = joined([str(allowed), why], " ") if why else str(allowed)
    return joined([text, hint]) if hint else text


def _of_kind(kind: Kind) -> str:
    return said("for a {kind}", kind=_KINDS[kind])


class Believable:
    """Plausibility checks of the rows of one file, block by block."""

    def __init__(self, columns: Columns, machine: Machine) -> None:
        self._ranges = column_ranges(columns, machine)
        self._value = {**_VALUE, Kind.ROTATION: TURNED} if machine.structure.rotary else _VALUE
        self._sd: dict[Kind, tuple[float, float]] = {}

    def wrong(
        self, numbers: Mapping[str, F64], kind: NDArray[np.int8]
    ) -> Iterator[tuple[Mask, str, str, str]]:
        """Of some rows: which are wrong, in which column, what is the matter, what was expected."""
        for name, (allowed, why) in self._ranges.items():
            if name in numbers:
                outside = allowed.outside(numbers[name])
                hint = _fahrenheit(numbers[name], outside, allowed)
                yield outside, name, _NOT_BELIEVABLE, in_words(allowed, why, hint)
        for value in np.unique(kind).tolist():
            rows = kind == value
            allowed = self._value[Kind(value)]
            why = _of_kind(Kind(value))
            bad = rows & allowed.outside(numbers["value"])
            yield bad, "value", _NOT_BELIEVABLE, in_words(allowed, why)
            if "sd" in numbers:
                yield from self._deviations(numbers["sd"], rows, Kind(value), why)
            if "gauge_sd" in numbers:
                allowed = _SD[Kind(value)]
                outside = rows & allowed.outside(numbers["gauge_sd"])
                yield outside, "gauge_sd", _NOT_BELIEVABLE, in_words(allowed, why)

    def _deviations(
        self, sd: F64, rows: Mask, kind: Kind, why: str
    ) -> Iterator[tuple[Mask, str, str, str]]:
        allowed = _SD[kind]
        yield rows & allowed.outside(sd), "sd", _NOT_BELIEVABLE, in_words(allowed, why)
        stated = sd[rows & np.isfinite(sd)]
        if not len(stated):
            return
        smallest, largest = float(stated.min()), float(stated.max())
        low, high = self._sd.get(kind, (np.inf, 0.0))
        low, high = min(low, smallest), max(high, largest)
        self._sd[kind] = low, high
        if high <= SD_RATIO * low:
            return
        # the odd one of the file's extremes: the other may stand in an earlier piece
        above = largest == high and (smallest > low or largest / np.median(stated) > SD_RATIO**0.5)
        yield (
            rows & (sd == (largest if above else smallest)),
            "sd",
            said("too far from the uncertainties of other rows to be weighed with them"),
            said(
                "uncertainties within a factor of {factor} (they run from {low} to {high}); a row "
                "that is not to count is left out",
                factor=f"{SD_RATIO:g}",
                low=f"{low:g}",
                high=f"{high:g}",
            ),
        )
