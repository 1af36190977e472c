"""Shaped effects, whose error motion is a shape over one axis's position: what they share."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import model_validator

from abbe.compcore.effects.base import F64, Component, Effect, ErrorMotion, Motion, Parameter
from abbe.compcore.effects.keys import Numbers
from abbe.compcore.effects.shapes import Shape
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine


class ShapedEffect(Effect):
    """An error motion of one axis that depends on that axis's own position through a shape."""

    axis: str
    shape: str = "spline:8"
    positions: Numbers = ()

    @model_validator(mode="after")
    def _shape_is_sound(self) -> ShapedEffect:
        Shape.parse(self.shape, self.positions)
        return self

    def check(self, machine: Machine) -> None:
        """Knots inside the axis's travel."""
        super().check(machine)
        self.parsed_shape(machine).check(machine.axis(self.axis))

    def component(self) -> Component:
        """The component of the error motion that the shape describes."""
        raise NotImplementedError

    def plausible(self) -> tuple[float, float]:
        """Plausible range of a coefficient, mm or rad."""
        return (-0.2, 0.2) if self.component() in "XYZ" else (-5e-4, 5e-4)

    def parsed_shape(self, machine: Machine) -> Shape:
        """The shape, its table positions in mm or rad."""
        scale = _DEGREE if machine.axis(self.axis).rotary else 1.0
        return Shape.parse(self.shape, tuple(p * scale for p in self.positions))

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """One coefficient a basis function, mm or rad."""
        error_motion = ErrorMotion(self.axis, self.component())
        return tuple(
            Parameter(
                name, error_motion.unit, self.plausible(), f"{error_motion}: {self.shape}, {name}"
            )
            for name in self.parsed_shape(machine).names
        )

    def basis(self, machine: Machine, conditions: Conditions) -> F64:
        """The shape's basis functions at the axis's positions, shape (n, p), unit-free."""
        axis = machine.axis(self.axis)
        shape = self.parsed_shape(machine)
        position = conditions.position(self.axis)
        key = ("shape", axis, shape)
        return conditions.cached(key, position, lambda: shape.basis(position, axis))

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """The shape's basis functions on the one error motion."""
        return (Motion(ErrorMotion(self.axis, self.component()), self.basis(machine, conditions)),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The axis itself, unless the shape is constant."""
        return () if self.shape == "constant" else (self.axis,)

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The table's positions; else the ends of the travel, where values are held."""
        if self.shape == "constant":
            return {}
        return {self.axis: self.parsed_shape(machine).kinks(machine.axis(self.axis))}


_DEGREE = 3.141592653589793 / 180.0
