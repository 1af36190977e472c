"""Hypotheses about a controller's convention: which are tried, and which count as simpler."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention, OwnTravel, levers, selectors
from abbe.compcore.maps.table import COMPONENTS

F64 = NDArray[np.float64]
Point = Mapping[str, float] | None

_FITTED_COUNTS = 4


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis: a convention, a structure, and whether an artefact was measured.

    Attributes
    ----------
    structure
        The chain order.
    convention
        Signs, rotation point, levers, forms of squareness.
    artefact
        The points come from measuring an artefact, not from switching the correction on and off:
        the differences have the opposite sign.
    fitted_point
        The rotation point was estimated from the points.
    """

    structure: Structure
    convention: Convention
    artefact: bool = False
    fitted_point: bool = False

    def key(self) -> tuple[object, ...]:
        """Key under which equal hypotheses are one."""
        c = self.convention
        point = (
            None
            if c.rotation_point is None
            else tuple(sorted((a, p) for a, p in c.rotation_point.items() if p != 0.0))
        )
        signs = tuple(sorted(c.reversed))
        return (
            str(self.structure),
            signs,
            point,
            c.own_travel,
            c.squareness,
            c.stated,
            self.artefact,
        )

    def twin(self) -> Hypothesis:
        """The hypothesis with all signs and the artefact reversed: the same to first order."""
        every = {(a, c) for a in self.structure.linear for c in COMPONENTS}
        turned = replace(self.convention, reversed=self.convention.reversed ^ every)
        return replace(self, convention=turned, artefact=not self.artefact)

    def words(self, stated: Structure) -> list[str]:
        """Deviations from Abbe's own conventions and the stated structure, in words."""
        c, axes = self.convention, self.structure.linear
        found = []
        if self.structure != stated:
            found.append(f"chain {' '.join(self.structure.axes)}")
        found += [f"{selector}=-1" for selector in selectors(c.reversed, axes)]
        point = {a: p for a, p in (c.rotation_point or {}).items() if p != 0.0}
        if point:
            where = ", ".join(f"{a}={p:g}" for a, p in sorted(point.items()))
            fitted = " (estimated)" if self.fitted_point else ""
            found.append(f"rotation point {where}{fitted}")
        if c.own_travel != "structure":
            found.append(f"own travel {c.own_travel} in the lever")
        if c.squareness != "as written":
            found.append(f"the map's own squareness as {c.squareness}")
        if c.stated != "angle":
            found.append(f"the stated squareness as {c.stated}")
        if self.artefact:
            found.append("opposite sign: an artefact was measured")
        return found

    def describe(self, stated: Structure) -> str:
        """The hypothesis in one line of text."""
        return "; ".join(self.words(stated)) or "Abbe's own conventions"

    def deviations(self, stated: Structure) -> int:
        """Number of deviations from the simplest convention; decides between equal residuals."""
        point = self.convention.rotation_point or {}
        places = sum(1 for p in point.values() if p != 0.0)
        words = len(self.words(stated)) - (1 if places else 0)
        return words + (_FITTED_COUNTS if self.fitted_point else places)


def structures(stated: Structure, any_order: bool) -> list[Structure]:
    """The stated structure; with `any_order` all others with as many axes on each side."""
    if not any_order:
        return [stated]
    cut = len(stated.workpiece_side)
    found = [
        replace(stated, workpiece_side=tuple(order[:cut]), tool_side=tuple(order[cut:]))
        for order in permutations(stated.axes)
    ]
    return [stated, *(s for s in found if s != stated)]


def own_travels(machine: Machine) -> list[OwnTravel]:
    """The ways of counting an axis's own travel as a lever that differ on this machine."""
    sides = {machine.own_move_in_lever(a) for a in machine.structure.linear}
    found: list[OwnTravel] = ["structure"]
    if sides != {False}:
        found.append("never")
    if sides != {True}:
        found.append("always")
    return found


def lever_axes(machine: Machine) -> tuple[str, ...]:
    """Axes whose travel is a lever of any axis's angular errors: those a rotation point has."""
    used = {b for a in machine.structure.linear for b in levers(machine, a)}
    return tuple(a for a in machine.structure.linear if a in used)


def named_points(machine: Machine, declared: bool) -> Iterator[Point]:
    """Rotation points to try, mm: as the machine declares, the map's zero, ends of travels."""
    if declared:
        yield None
    axes = lever_axes(machine)
    places = [dict.fromkeys([0.0, *machine.axis(a).travel]) for a in axes]
    for choice in product(*places):
        yield {a: p for a, p in zip(axes, choice, strict=True) if p != 0.0}


def sign_choices(axes: tuple[str, ...]) -> list[frozenset[tuple[str, str]]]:
    """Sets of reversed columns to try, simpler ones first.

    All linear errors or none; rotations about each direction; linear errors and rotations of
    each axis; and one odd column among otherwise uniform ones.
    """
    every = [(a, c) for a in axes for c in COMPONENTS]
    linear = frozenset(s for s in every if s[1] in "XYZ")
    angular = frozenset(s for s in every if s[1] in "ABC")
    uniform = [frozenset(), angular, linear, linear | angular]
    found: dict[frozenset[tuple[str, str]], None] = dict.fromkeys(uniform)
    about = [frozenset(s for s in every if s[1] == c) for c in "ABC"]
    for base in (frozenset[tuple[str, str]](), linear):
        for some in _subsets(about):
            found[base | some] = None
    of_axes = [frozenset(s for s in linear if s[0] == a) for a in axes]
    of_axes += [frozenset(s for s in angular if s[0] == a) for a in axes]
    for some in _subsets(of_axes):
        found[some] = None
    for base in uniform:
        for one in every:
            found[base ^ {one}] = None
    return list(found)


def sign_rows(choices: Iterable[frozenset[tuple[str, str]]], sources: list[tuple[str, str]]) -> F64:
    """Sets of reversed columns as rows of ±1, shape (choices, sources)."""
    return np.array([[-1.0 if s in chosen else 1.0 for s in sources] for chosen in choices])


def _subsets(
    groups: list[frozenset[tuple[str, str]]],
) -> Iterator[frozenset[tuple[str, str]]]:
    for picked in product((False, True), repeat=len(groups)):
        some = (g for g, chosen in zip(groups, picked, strict=True) if chosen)
        yield frozenset[tuple[str, str]]().union(*some)
