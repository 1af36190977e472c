"""The placing of an instrument while a foreign file was recorded, and the campaign from it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.columns import AXIS
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.plausible import (
    DISPLACEMENT,
    ROTATION,
    TRAVEL,
    TRAVEL_ROTARY,
    TURNED,
    Range,
    position_range,
)
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

COMPONENTS = "XYZABC"
"""What can be measured along a line: a displacement along X Y Z, a rotation about X Y Z (A B C)."""


@dataclass(frozen=True)
class ForeignPlacing:
    """The instrument's placing, which a foreign file does not say.

    Attributes
    ----------
    at
        Positions of the axes that did not move, mm (rotary: rad).
    tool
        Tool or probe offset, mm.
    setup
        Name of the set-up; the file's name where empty.
    sd
        Standard uncertainty of a reading, mm or rad; None: not stated.
    signals
        Name → value that was the same throughout, in the signal's own unit.
    sign
        −1 where the file's sign is opposite to the one assumed.
    """

    at: Mapping[str, float] = field(default_factory=dict)
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    setup: str = ""
    sd: float | None = None
    signals: Mapping[str, float] = field(default_factory=dict)
    sign: int = 1


@dataclass(frozen=True)
class Readings:
    """Readings of one set-up.

    Attributes
    ----------
    positions, directions
        Axis that moved → (n,), mm or rad; 1, −1 or 0.
    kind
        What was measured.
    value
        Shape (n,): error = actual − indicated, mm or rad.
    u
        Shape (n, 3): unit vector of the measured component.
    free
        What the placing leaves unknown.
    line
        Shape (n,): line in the foreign file.
    suffix
        Added to the set-up's name where a file makes several.
    signals
        Name → (n,), where the file records them; else those of the placing.
    sd
        Shape (n,), mm or rad: standard uncertainty; None: that of the placing.
    tool
        Shape (n, 3), mm: the tool's offset; None: that of the placing.
    time
        Shape (n,), s since the file's first moment; None: the file has no times.
    gauge, gauge_sd
        Shape (n,): what the row was measured against, empty where nothing, and the standard
        uncertainty of its calibration, mm; None where nothing was.
    """

    positions: Mapping[str, F64]
    directions: Mapping[str, I64]
    kind: Kind
    value: F64
    u: F64
    free: tuple[str, ...]
    line: I64
    suffix: str = ""
    signals: Mapping[str, F64] = field(default_factory=dict)
    sd: F64 | None = None
    tool: F64 | None = None
    gauge: Sequence[str] | None = None
    gauge_sd: F64 | None = None
    time: F64 | None = None


def along_line(
    axis: str, component: str, position: F64, direction: I64, value: F64, line: I64
) -> Readings:
    """Readings of one component of error along one axis: ``E_(component)(axis)``.

    A straightedge's direction is arbitrary: straightness leaves a slope free besides the zero.
    """
    rotation = component in "ABC"
    u = np.zeros((len(value), 3))
    u[:, COMPONENTS.index(component) % 3] = 1.0
    straightness = not rotation and component != own_component(axis)
    return Readings(
        {axis: position},
        {axis: direction},
        Kind.ROTATION if rotation else Kind.DISPLACEMENT,
        value,
        u,
        ("zero", "slope") if straightness else ("zero",),
        line,
    )


def place(
    source: Path,
    data: bytes,
    readings: Sequence[Readings],
    placing: ForeignPlacing,
    notes: Sequence[str],
    metadata: Mapping[str, str] | None = None,
    machine: Machine | None = None,
) -> Campaign:
    """The campaign that readings and placing make together.

    Rows of a file without times all stand at 0 s, in the order measured.

    Raises
    ------
    InputError
        When the machine has an axis whose position is not stated, or lacks one that is.
    """
    for r in readings:
        _check_readings(r, source, machine)
    moving = list(dict.fromkeys(a for r in readings for a in r.positions))
    axes = list(dict.fromkeys([*placing.at, *moving]))
    if machine is not None:
        _check_axes(axes, machine)
        axes = list(machine.structure.axes)
    base = placing.setup or source.stem
    count = [len(r.value) for r in readings]
    n = sum(count)
    names = np.repeat([base + r.suffix for r in readings], count)
    still = {a: np.full(n, placing.at.get(a, 0.0)) for a in axes}
    table = {a: np.zeros(n, dtype=np.int64) for a in moving}
    first = 0
    for r, length in zip(readings, count, strict=True):
        part = slice(first, first + length)
        for a in moving:
            if a in r.positions:
                still[a][part], table[a][part] = r.positions[a], r.directions[a]
        first += length
    conditions = Conditions(
        positions=still,
        directions={a: d.astype(np.float64) for a, d in table.items()},
        tool=np.concatenate(
            [
                np.tile(placing.tool, (len(r.value), 1)) if r.tool is None else r.tool
                for r in readings
            ]
        ),
        time=np.concatenate(
            [np.zeros(len(r.value)) if r.time is None else r.time for r in readings]
        ),
        signals=_signals(source, readings, placing),
        run=np.zeros(n, dtype=np.int64),
        setup=names,
        u=np.concatenate([r.u for r in readings]),
        base=np.zeros(n, dtype="<U1"),
    )
    head = {"format": "abbe-campaign/1", **(metadata or {}), "notes": "; ".join(notes)}
    return Campaign(
        name=source.name,
        conditions=conditions,
        kind=np.concatenate([np.full(len(r.value), r.kind, dtype=np.int8) for r in readings]),
        value=np.concatenate([r.value for r in readings]) * placing.sign,
        sd=np.concatenate([_sd(r, placing) for r in readings]),
        base2=np.zeros(n, dtype="<U1"),
        tool_name=np.zeros(n, dtype="<U1"),
        line=np.concatenate([r.line for r in readings]),
        setups={base + r.suffix: Setup(base + r.suffix, r.free) for r in readings},
        files={str(source): hashlib.sha256(data).hexdigest()},
        metadata=(head,),
        **_gauges(readings),
    )


def _gauges(readings: Sequence[Readings]) -> dict[str, Any]:
    """Names of gauges and their uncertainties, where there are any."""
    if all(r.gauge is None for r in readings):
        return {}
    names = [name for r in readings for name in (r.gauge or [""] * len(r.value))]
    sd = [np.zeros(len(r.value)) if r.gauge_sd is None else r.gauge_sd for r in readings]
    return {"gauge": np.array(names, dtype=np.str_), "gauge_sd": np.concatenate(sd)}


def _sd(readings: Readings, placing: ForeignPlacing) -> F64:
    if readings.sd is not None:
        return readings.sd
    return np.full(len(readings.value), np.nan if placing.sd is None else placing.sd)


def _signals(source: Path, readings: Sequence[Readings], placing: ForeignPlacing) -> dict[str, F64]:
    """Signals as the file records them, the placing's where it does not."""
    found = {}
    for name in dict.fromkeys([*placing.signals, *(s for r in readings for s in r.signals)]):
        parts = []
        for r in readings:
            if name not in r.signals and name not in placing.signals:
                raise InputError("a signal that not all rows have", file=source, field=name)
            constant = placing.signals.get(name, 0.0)
            parts.append(r.signals.get(name, np.full(len(r.value), constant)))
        found[name] = np.concatenate(parts)
    return found


def _check_readings(readings: Readings, source: Path, machine: Machine | None) -> None:
    """Refuse positions and deviations that nothing on a machine can have; names the line."""
    columns: list[tuple[str, F64, Range]] = []
    for axis, position in readings.positions.items():
        rotary = is_rotary(axis)
        allowed = TRAVEL_ROTARY if rotary else TRAVEL
        if machine is not None and axis in machine.axes:
            allowed = position_range(machine.axes[axis])
        columns.append((axis, np.rad2deg(position) if rotary else position, allowed))
    turned = TURNED if any(map(is_rotary, readings.positions)) else ROTATION
    allowed, per = (turned, 1e6) if readings.kind == Kind.ROTATION else (DISPLACEMENT, 1e3)
    columns.append(("deviation", readings.value * per, allowed))
    for field_name, values, allowed in columns:
        outside = allowed.outside(values)
        if outside.any():
            row = int(outside.argmax())
            raise InputError(
                "not believable",
                file=source,
                line=int(readings.line[row]),
                field=field_name,
                found=f"{values[row]:g}",
                expected=str(allowed),
            )


def _check_axes(stated: Sequence[str], machine: Machine) -> None:
    for axis in stated:
        machine.axis(axis, "at")
    for axis in machine.structure.axes:
        if axis not in stated:
            unit = "degrees" if is_rotary(axis) else "mm"
            raise InputError(
                f"the position of axis {axis} is not stated",
                field="at",
                found=", ".join(stated),
                expected=f"where {axis} stood, {unit}",
            )


def component_of(axis: str, component: str | None) -> str:
    """The component measured: what was asked for, else the one the axis itself commands.

    Raises
    ------
    InputError
        When it is not one of X Y Z A B C, or the axis is none.
    """
    if not AXIS.fullmatch(axis):
        raise InputError(
            "not the name of an axis", field="axis", found=axis, expected="X Y Z U V W A B or C"
        )
    if component is None:
        return own_component(axis)
    if component not in COMPONENTS or len(component) != 1:
        raise InputError(
            "not a component of an error motion",
            field="component",
            found=component,
            expected="X, Y, Z (displacement along) or A, B, C (rotation about X, Y, Z)",
        )
    return component


def read_bytes(path: Path) -> bytes:
    """A file's content.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError("no such file", file=path) from None
    except IsADirectoryError:
        raise InputError("is a folder, not a file", file=path) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from None
