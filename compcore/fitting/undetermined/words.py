"""The null space of a campaign in a metrologist's words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.undetermined.by_fewest import by_fewest
from abbe.compcore.fitting.undetermined.null_space import NullSpace
from abbe.compcore.sentences import joined, said

F64 = NDArray[np.float64]

_WHOLE = {True: 1e-7, False: 1e-3}
"""A direction (convention or not) belongs to some effects when less than this part of its square
lies elsewhere; what is unknown is seldom exactly so."""


@dataclass(frozen=True, slots=True)
class Undetermined:
    """An undetermined combination of unknowns, in words.

    Attributes
    ----------
    text
        One sentence.
    effects
        The specs of the effects that take part.
    convention
        Whether it is only a matter of convention; else predictions that need it are unknown.
    alone
        Its name where it is one effect that is not shown at all, or not in one part; else empty.
    """

    text: str
    effects: tuple[str, ...]
    convention: bool
    alone: str = ""


def in_words(problem: Problem, theta: F64, null: NullSpace) -> list[Undetermined]:
    """All undetermined combinations in words: unknowns first, conventions summarised.

    Parameters
    ----------
    problem, theta
        What was fitted, and the solution.
    null
        The null space, divided.
    """
    by_group: dict[tuple[int, ...], list[F64]] = {}
    for group, direction in by_fewest(problem, null.unknown, _WHOLE[False]):
        by_group.setdefault(tuple(group), []).append(direction)
    found = []
    for terms, directions in by_group.items():
        several = len(directions) > 1
        names = [_part(problem, theta, t, None if several else directions[0]) for t in terms]
        if len(names) == 1:
            text = said(
                "{what}: this campaign does not show it (left at the value of least norm); "
                "predictions that need it are uncertain by its whole plausible range",
                what=names[0],
            )
        else:
            text = said(
                "{what}: this campaign does not show {count} of them; predictions that need it are "
                "uncertain by the plausible range",
                what=_listed(names),
                count=said("{n} combinations", n=len(directions))
                if several
                else said("a combination"),
            )
        alone = names[0] if len(names) == 1 else ""
        found.append(Undetermined(text, _specs(problem, terms), False, alone))
    return found + _conventions(problem, theta, null.convention)


def _conventions(problem: Problem, theta: F64, directions: F64) -> list[Undetermined]:
    alone: dict[str, int] = {}
    alike: list[dict[str, int]] = []
    mixed: list[dict[str, int]] = []
    for group, own in by_fewest(problem, directions, _WHOLE[True]):
        parts = {_part(problem, theta, t, own): t for t in group}
        if len(parts) == 1:
            alone.update(parts)
        elif len(parts) == 2:
            # what is the same as one of a family is the same as all of it
            same = [family for family in alike if family.keys() & parts.keys()]
            alike = [family for family in alike if family not in same]
            alike.append({k: t for family in [*same, parts] for k, t in family.items()})
        else:
            mixed.append(parts)
    found = []
    if alone:
        text = said(
            "{what}: arbitrary, as every set-up has its own zero and no place of the machine is a "
            "reference; fixed by convention",
            what=_listed(alone),
        )
        found.append(Undetermined(text, _specs(problem, alone.values()), True))
    for families, same_thing in ((alike, True), (mixed, False)):
        for family in families:
            carriers = [n for n, t in family.items() if t >= 0 and problem.model.effects[t].carries]
            what = _listed(family)
            text = (
                said(
                    "{what} are the same thing for this campaign; the split shown is minimum-norm",
                    what=what,
                )
                if same_thing
                else said(
                    "{what} make up one thing for this campaign; the split shown is minimum-norm",
                    what=what,
                )
            )
            if carriers:
                text = said("{text}, in favour of {what}", text=text, what=_joined(carriers))
            found.append(Undetermined(text, _specs(problem, family.values()), True))
    return found


def _specs(problem: Problem, terms: Iterable[int]) -> tuple[str, ...]:
    return tuple(problem.model.effects[t].spec for t in terms if t >= 0)


_PLACED = {
    -1: "the base points' place",
    -2: "the tools' offsets",
    -3: "how warm bodies were when a run began",
}


def _part(problem: Problem, theta: F64, term: int, direction: F64 | None) -> str:
    """Which part of an effect a null direction is: its constant, its slope, …; None: all of it."""
    if term < 0:
        return _PLACED[term]
    layout = problem.layout
    effect = problem.model.effects[term]
    if direction is None:
        return _name(effect)
    where = layout.terms[term]
    values = (direction[:, 0] * layout.scale)[where]
    count = layout.linear_counts[term]
    if where.stop - where.start == 1 or abs(values[count:]).any():
        nonlinear = [u.name for u in layout.unknowns[where][count:]]
        return _name(effect) + (f" ({', '.join(nonlinear)})" if abs(values[count:]).any() else "")
    form = _form(problem, theta, term, values)
    part = _FORMS[form][0] if form in _FORMS else said("a part")
    return said("{part} of {what}", part=part, what=_name(effect))


def _form(problem: Problem, theta: F64, term: int, values: F64) -> str:
    effect, machine = problem.model.effects[term], problem.model.machine
    axes = effect.positions_used(machine)
    if len(axes) != 1:
        return _A_PART
    axis = machine.axes[axes[0]]
    q = np.linspace(*axis.travel, 50)
    conditions = problem.conditions(theta)
    index = np.zeros(50, dtype=np.int64)
    at = conditions.rows(index)
    at = at.moved({axes[0]: q - at.position(axes[0])})
    motions = effect.motions(machine, at, problem.layout.nonlinear_values(term, theta))
    curve = np.concatenate([m.amount(values) for m in motions])
    if len(motions) != 1:
        return _A_PART
    size = float(np.abs(curve).max())
    x = (q - axis.middle) / axis.half_travel
    for degree, word in enumerate(_FORMS):
        fitted = np.polynomial.Polynomial.fit(x, curve, degree)
        if float(np.abs(curve - fitted(x)).max()) < 1e-6 * size:
            return word
    return _A_PART


def _name(effect: Effect) -> str:
    error_motion = getattr(effect, "component", None)
    where = effect.where()
    if callable(error_motion) and "axis" in where and "axes" not in where:
        return f"E_{error_motion()}{where['axis']}"
    if "axes" in where:
        return f"{effect.kind.replace('_', ' ')} {'–'.join(where['axes'])}"
    return effect.spec


def _listed(names: Iterable[str]) -> str:
    """``the constants of E_XX and E_YY, the slope of E_YX and squareness X–Y``."""
    by_form: dict[str, list[str]] = {}
    others = []
    for name in names:
        form, of, what = name.partition(" of ")
        if of and form.startswith("the "):
            by_form.setdefault(form, []).append(what)
        else:
            others.append(name)
    named = [
        said("{part} of {what}", part=_FORMS[form][len(what) > 1], what=_joined(what))
        for form, what in by_form.items()
    ]
    return _joined(named + others)


_A_PART = "a part"
_FORMS = {
    "the constant": (said("the constant"), said("the constants")),
    "the slope": (said("the slope"), said("the slopes")),
    "the parabola": (said("the parabola"), said("the parabolas")),
}
"""Form of a curve → in words, of one effect and of several."""


def _joined(names: Sequence[str]) -> str:
    if len(names) == 1:
        return names[0]
    return said("{these} and {last}", these=joined(names[:-1], ", "), last=names[-1])
