"""Targets of effects: the error motion given by an axis, a direction or a turn about one."""

from __future__ import annotations

from pydantic import model_validator

from abbe.compcore.effects.base import FUNCTIONAL_POINT, AxisLetter, Component, Effect, ErrorMotion
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine, own_component

TRANSLATIONS: tuple[Component, ...] = ("X", "Y", "Z")
ROTATIONS: tuple[Component, ...] = ("A", "B", "C")
_TURNED: dict[str, AxisLetter] = {"A": "X", "B": "Y", "C": "Z"}


def along(axis: str) -> ErrorMotion:
    """An axis's positioning error motion: E_XX, E_YV, E_CC, …"""
    component: Component = own_component(axis)  # type: ignore[assignment]
    return ErrorMotion(axis, component)


def turned_about(axis: str) -> AxisLetter:
    """The machine direction about which a rotary axis turns: Z for C (ISO 841)."""
    return _TURNED[own_component(axis)]


def require_linear(machine: Machine, axis: str, kind: str, key: str = "axis") -> None:
    """Check that an axis is linear; a rotary one raises `InputError`."""
    if machine.axis(axis, key).rotary:
        raise InputError(
            f"{kind} is an effect of linear axes",
            field=key,
            found=axis,
            expected="one of " + (", ".join(machine.structure.linear) or "none on this machine"),
        )


def require_rotary(machine: Machine, axis: str, kind: str) -> None:
    """Check that an axis is rotary; a linear one raises `InputError`."""
    if not machine.axis(axis).rotary:
        raise InputError(
            f"{kind} is an effect of rotary axes",
            field="axis",
            found=axis,
            expected="one of " + (", ".join(machine.structure.rotary) or "none on this machine"),
        )


class ShiftEffect(Effect):
    """A shift, either in a ``direction`` at the functional point or along one ``axis``.

    For a linear axis that no rotary axis turns, ``axis=X`` and ``direction=X`` are the same.
    """

    direction: AxisLetter | None = None
    axis: str | None = None

    @model_validator(mode="after")
    def _one_of_the_two(self) -> ShiftEffect:
        if (self.direction is None) == (self.axis is None):
            raise InputError(
                f"{self.kind} needs a direction or an axis, not both", expected="direction=X"
            )
        return self

    def error_motion(self) -> ErrorMotion:
        """The error motion that is shifted."""
        if self.direction is not None:
            return ErrorMotion(FUNCTIONAL_POINT, self.direction)
        return along(str(self.axis))

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: the shift is the same everywhere."""
        return ()


def shift_targets(machine: Machine) -> list[dict[str, str]]:
    """Where a shift can be told apart: the three directions, and axes that are not fixed to them.

    An axis that a rotary axis turns, an axis that is tilted, and every rotary axis.
    """
    targets = [{"direction": d} for d in "XYZ"]
    structure = machine.structure
    for i, name in enumerate(structure.axes):
        axis = machine.axis(name)
        side = structure.workpiece_side
        # what stands between the axis and the bed turns it
        to_bed = (
            structure.axes[i + 1 : len(side)] if name in side else structure.axes[len(side) : i]
        )
        turned = any(machine.axis(a).rotary for a in to_bed)
        tilted = max(abs(c) for c in axis.direction) < 1.0 - 1e-12
        if axis.rotary or turned or tilted:
            targets.append({"axis": name})
    return targets
