"""The map or model whose application is to be identified, taken apart into signed columns.

Every column of a map (every error motion of a model) is a *source* whose sign a vendor may have
turned. A source moves one error motion, or several where squareness is moved from one form to
the other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects import Squareness
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.kinematics import Chain, exact, first_order
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention, OwnTravel, SquarenessForm
from abbe.compcore.maps.squareness import (
    Form,
    square_pairs,
    third_direction,
    with_squareness,
    with_squareness_as,
)
from abbe.compcore.maps.table import COMPONENTS, CompensationMap
from abbe.compcore.maps.to_model import map_machine
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]
Forms = tuple[SquarenessForm, Form]
"""In which form a map's own squareness is applied, and in which one that is stated beside it."""
Source = tuple[str, str]
"""(axis, ISO letter of the component) of a column; an axis ``""`` for what no sign belongs to."""


@dataclass(frozen=True, slots=True)
class MotionPart:
    """The contribution of one column to one error motion at n points, (n,), mm or rad."""

    source: Source
    error_motion: ErrorMotion
    values: F64


class Subject(ABC):
    """A map or a model whose application by a controller is to be identified."""

    composition: str = "exact"

    @abstractmethod
    def machine(self, structure: Structure) -> Machine:
        """The machine in a structure, before any convention is applied."""

    @abstractmethod
    def forms(self) -> tuple[Forms, ...]:
        """Forms of squareness to try, the map's own first; a stated one first as an angle."""

    @abstractmethod
    def parts(self, machine: Machine, forms: Forms, at: Conditions) -> list[MotionPart]:
        """Contributions of all columns at n points; `machine` carries the convention's levers."""

    def at(self, conditions: Conditions) -> Predictor:
        """A predictor of corrections at these points."""
        return Predictor(self, conditions)


class Predictor:
    """Corrections at fixed points under any convention; what conventions share is computed once."""

    def __init__(self, subject: Subject, conditions: Conditions) -> None:
        self._subject, self._conditions = subject, conditions
        self._parts: dict[tuple[Structure, OwnTravel, Forms], list[MotionPart]] = {}

    def correction(self, structure: Structure, convention: Convention) -> F64:
        """The correction (reading on minus off) under a convention, shape (n, 3), mm."""
        at = self._conditions
        machine = convention.on(self._subject.machine(structure))
        forms = (convention.squareness, convention.stated)
        key = (structure, convention.own_travel, forms)
        if key not in self._parts:
            self._parts[key] = self._subject.parts(machine, forms, at)
        sums: dict[ErrorMotion, F64] = {}
        for part in self._parts[key]:
            value = part.values * convention.sign(*part.source)
            sums[part.error_motion] = (
                sums[part.error_motion] + value if part.error_motion in sums else value
            )
        compose = exact if self._subject.composition == "exact" else first_order
        return compose(Chain(machine, at), sums)[0]


class MapSubject(Subject):
    """A compensation map, with squarenesses stated beside it (rad, Abbe's sign)."""

    def __init__(
        self,
        compensation: CompensationMap,
        squareness: Mapping[tuple[str, str], float] | None = None,
    ) -> None:
        self._map = compensation
        self._squareness = squareness or {}

    def machine(self, structure: Structure) -> Machine:
        """The map's machine in a structure; travels are the ranges of the tables, mm."""
        return map_machine(self._map, structure)

    def forms(self) -> tuple[Forms, ...]:
        """Forms of the map's own squareness, or of the one that is stated beside it."""
        stated: tuple[Form, ...] = ("angle", "gradient") if self._squareness else ("angle",)
        own: tuple[SquarenessForm, ...] = ("as written", "angle", "gradient")
        return tuple((form, beside) for beside in stated for form in own)

    def parts(self, machine: Machine, forms: Forms, at: Conditions) -> list[MotionPart]:
        """The contribution of each column; a squareness is moved column by column."""
        form, stated = forms
        parts = []
        for axis, table in self._map.tables.items():
            for k, component in enumerate(COMPONENTS):
                only = np.zeros((len(table.positions), 6))
                only[:, k] = table.array()[:, k]
                if only.any():
                    blank = self._blank().replaced(table.with_array(only))
                    moved = with_squareness_as(blank, form, machine)
                    parts += _tabled((axis, component), moved, at)
        for (a, b), angle in self._squareness.items():
            pair = (a, b) if (a, b) in square_pairs(machine) else (b, a)
            turn = angle if pair == (a, b) else -angle
            beside = with_squareness(self._blank(), machine, pair, turn, stated)
            parts += _tabled(("", ""), beside, at)
        return parts

    def _blank(self) -> CompensationMap:
        tables = self._map.tables.values()
        return self._map.replaced(*(t.scaled([0.0] * 6) for t in tables))


class ModelSubject(Subject):
    """A fitted model; conventions override its own rotation points and levers."""

    def __init__(self, model: Model) -> None:
        if model.machine.structure.rotary:
            raise InputError(
                "conventions are identified on machines with linear axes only",
                field="structure",
                found=str(model.machine.structure),
            )
        self._model = model
        self.composition = model.composition

    def machine(self, structure: Structure) -> Machine:
        """The model's machine; its effects belong to its own structure.

        Raises
        ------
        InputError
            For another structure.
        """
        if structure != self._model.machine.structure:
            raise InputError(
                "a model's chain order cannot be changed; give the map instead",
                field="structure",
                found=str(structure),
                expected=str(self._model.machine.structure),
            )
        return self._model.machine

    def forms(self) -> tuple[Forms, ...]:
        """As written; an effect ``squareness`` states a squareness, which has both forms."""
        has = any(isinstance(t.effect, Squareness) and t.fitted for t in self._model.terms)
        angle: tuple[Forms, ...] = (("as written", "angle"),)
        return (*angle, ("as written", "gradient")) if has else angle

    def parts(self, machine: Machine, forms: Forms, at: Conditions) -> list[MotionPart]:
        """One source an error motion of an axis; everything else keeps its sign."""
        sloped = {
            i: (t.effect.axes, t.values["angle"].value)
            for i, t in enumerate(self._model.terms)
            if forms[1] == "gradient" and isinstance(t.effect, Squareness) and t.fitted
        }
        terms = tuple(t for i, t in enumerate(self._model.terms) if i not in sloped)
        motions = replace(self._model, machine=machine, terms=terms).error_motions(at)
        linear = machine.structure.linear
        parts = [
            MotionPart((c.place, c.component) if c.place in linear else ("", ""), c, value)
            for c, value in motions.items()
        ]
        parts += [_gradient(axes, angle, at) for axes, angle in sloped.values()]
        return parts


def _tabled(source: Source, tables: CompensationMap, at: Conditions) -> list[MotionPart]:
    parts = []
    for axis, table in tables.tables.items():
        if not table.array().any():
            continue
        values = table.at(at.position(axis))
        parts += [
            MotionPart(source, ErrorMotion(axis, component), values[:, k])  # type: ignore[arg-type]
            for k, component in enumerate(COMPONENTS)
            if values[:, k].any()
        ]
    return parts


def _gradient(pair: tuple[str, str], angle: float, at: Conditions) -> MotionPart:
    """A squareness as a slope of the second axis's straightness along the first."""
    third, slope = third_direction(pair)
    source = (pair[0], "ABC"["XYZ".index(third)])
    error_motion = ErrorMotion(pair[1], own_component(pair[0]))  # type: ignore[arg-type]
    return MotionPart(source, error_motion, angle * slope * at.position(pair[1]))
