"""From what a controller measured to a reading: where the machine stood, its tool, temperatures."""

from __future__ import annotations

import math
from collections.abc import Sequence

from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import position_range
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.units import in_digits
from abbe.daemon.arguments.measurements.check_reading import TypedReading, Vec3
from abbe.daemon.arguments.point_arguments import Given
from abbe.daemon.checks.triggers import MeasuredPoint, NotTakenError
from abbe.daemon.config.sections.check_points import CheckPointSection
from abbe.daemon.pipeline.record import CycleRecord

_STILL = 0.5
"""mm/s (rotary: rad/s) below which an axis stands: encoders flicker by a count a cycle."""
_LARGEST = 1e5
"""µm: no machine errs by more."""
_PER_UM = {"mm": 1e-3, "um": 1.0, "µm": 1.0}


def reading_of(
    measured: MeasuredPoint,
    section: CheckPointSection,
    unit: str,
    record: CycleRecord,
    axes: Sequence[str],
    machine: Machine,
    tool: Vec3,
    when: float,
) -> tuple[TypedReading, dict[str, float]]:
    """A reading as `abbe check-point` takes it, and the signals at that time.

    Parameters
    ----------
    measured
        What the controller has measured.
    section
        Of that check point.
    unit
        Of the channel of its value: ``um`` or ``mm``.
    record
        The last cycle.
    axes
        Order of its positions.
    machine
        For ranges.
    tool
        The present tool, mm.
    when
        s since 1970.

    Raises
    ------
    NotTakenError
        When it cannot be used: where, or in which state, the machine was is not known.
    """
    signals = {n: r.value for n, r in record.signals.items() if not r.fault}
    signals = {n: v for n, v in signals.items() if math.isfinite(v)}
    if section.corrected and not record.in_full:
        raise NotTakenError("it was measured with corrected positions, not corrected in full")
    stood = dict(zip(axes, record.indicated, strict=True))
    found, value, u = None, 0.0, (0.0, 0.0, 0.0)
    if section.found is not None:
        found = _found(measured.values, machine)
        stood = {a: q for a, q in stood.items() if a not in ("X", "Y", "Z")}
    elif section.reference is not None:
        at = axes.index(section.reference)
        value = 1e3 * (record.reference[at] - record.indicated[at])
        u = _direction(section.reference)
        _require_still(record, axes, list(axes))
    else:
        value = measured.values[0] / _PER_UM[unit]
        u = _unit(section.u) if isinstance(section.u, tuple) else _direction(section.u or "X")
        _require_still(record, axes, [a for a in axes if a not in section.at])
        for axis, q in section.at.items():
            stood[axis] = math.radians(q) if is_rotary(axis) else q
    for axis, q in stood.items():
        if not math.isfinite(q):
            raise NotTakenError(f"where {axis} stood is not known")
    if not (math.isfinite(value) and abs(value) <= _LARGEST):
        raise NotTakenError(f"an error of {in_digits(value, 4)} µm is none of a machine")
    given = Given(positions=stood, tool=section.tool or tool)
    own = section.nominal if found else None
    typed = TypedReading(measured.name, found, own, value, u, False, section.sd, when, given)
    return typed, signals


def _found(values: tuple[float, ...], machine: Machine) -> Vec3:
    for axis, q in zip("XYZ", values, strict=True):
        if axis in machine.axes:
            allowed = position_range(machine.axes[axis])
            if not allowed.low <= q <= allowed.high:
                raise NotTakenError(
                    f"found at {axis} = {q:g} mm, outside of {allowed.low:g} to {allowed.high:g}"
                )
    return values[0], values[1], values[2]


def _require_still(record: CycleRecord, axes: Sequence[str], still: Sequence[str]) -> None:
    moving = dict(zip(axes, record.speeds, strict=False))
    for axis in still:
        if not moving.get(axis, 0.0) < _STILL:
            raise NotTakenError(f"{axis} moved when it was read: where it stood is not known")


def _direction(word: str) -> Vec3:
    sign = -1.0 if word.startswith("-") else 1.0
    x, y, z = (sign * float(word[-1] == axis) for axis in "XYZ")
    return x, y, z


def _unit(u: Vec3) -> Vec3:
    x, y, z = (part / math.hypot(*u) for part in u)
    return x, y, z
