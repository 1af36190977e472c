"""Adding an effect to a model or removing one: the next version, before it is refitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.errors import InputError, require_type
from abbe.compcore.model.model import Model, Term

DETAIL = (
    "shape", "positions", "within", "harmonics", "tau", "tau2", "start", "period", "gravity",
)  # fmt: skip
"""Where-keys that say in how much detail an effect is described, not which cause it is."""


_SAME = 1.2
"""Ratio of two periods up to which they are one, the better known."""


def identity(effect: Effect) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Key of an effect as a cause: kind and place, without its detail (shape, harmonics)."""
    where = effect.where()
    return effect.kind, tuple(sorted((k, str(v)) for k, v in where.items() if k not in DETAIL))


def with_effect(model: Model, kind: str, keys: Mapping[str, Any]) -> tuple[Model, Effect]:
    """A model with one more effect, not yet fitted.

    Where the model has the same cause in other detail (a spline with fewer coefficients), it is
    replaced. A wave of a stated period beside one of another period is another cause: a rack has
    its pinion's turn and its teeth.

    Raises
    ------
    InputError
        For an unknown kind or key, a machine on which the effect makes no sense, or an effect that
        the model has already.
    """
    effect = make_effect(kind, keys)
    effect.check(model.machine)
    terms = list(model.terms)
    for i, term in enumerate(terms):
        if identity(term.effect) != identity(effect) or _another_wave(model, term, effect):
            continue
        if term.effect == effect and effect.kind != "formula":
            raise InputError("the model has this effect already", found=effect.spec)
        terms[i] = Term(effect, switch=term.switch)
        return _unfitted(model, terms), effect
    return _unfitted(model, [*terms, Term(effect)]), effect


def _another_wave(model: Model, term: Term, effect: Effect) -> bool:
    """Whether an effect states a period that is not the one of a term of the model."""
    stated, known = getattr(effect, "period", None), getattr(term.effect, "period", None)
    if stated is None:
        return False
    if known is None and "period" in term.values:
        found = term.values["period"].value
        known = np.degrees(found) if model.machine.axis(effect.where()["axis"]).rotary else found
    return known is not None and not known / _SAME < stated < known * _SAME


def without_effect(model: Model, name: str) -> tuple[Model, Effect]:
    """A model without one of its effects; the others keep their values.

    Parameters
    ----------
    name
        Its spec as ``abbe history`` prints it, or as much of its beginning as is unique.

    Raises
    ------
    InputError
        When no effect, or more than one, is called that.
    """
    wanted = " ".join(name.split())
    exact = [i for i, t in enumerate(model.terms) if t.effect.spec == wanted]
    found = exact or [i for i, t in enumerate(model.terms) if t.effect.spec.startswith(wanted)]
    specs = [t.effect.spec for t in model.terms]
    if not found:
        raise InputError(
            "the model has no such effect", found=wanted, expected="one of " + "; ".join(specs)
        )
    if len(found) > 1:
        raise InputError(
            "more than one effect is called that",
            found=wanted,
            expected="one of " + "; ".join(specs[i] for i in found),
        )
    removed = model.terms[found[0]].effect
    return _unfitted(model, [t for i, t in enumerate(model.terms) if i != found[0]]), removed


def add_effect(model: Model, effect: Effect | str, **keys: Any) -> Model:
    """A model with one more effect, not yet fitted; see `with_effect`.

    Parameters
    ----------
    effect
        An effect, or its kind with `keys` beside it (``"backlash", axis="Z"``), or a whole spec as
        a diagnosis prints it (``"backlash axis=Z"``).

    Raises
    ------
    InputError
        As `with_effect`, and for a spec that is not made of KEY=VALUE.
    """
    require_type(model, Model, "model")
    if isinstance(effect, Effect):
        return with_effect(model, effect.kind, effect.where())[0]
    kind, *assignments = effect.split() or [effect]
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals or not key or key in keys:
            raise InputError("cannot read a spec", found=effect, expected="KIND KEY=VALUE …")
        keys[key] = value
    return with_effect(model, kind, keys)[0]


def remove_effect(model: Model, name: str) -> Model:
    """A model without one of its effects; the others keep their values.

    Parameters
    ----------
    name
        Its spec, or as much of its beginning as is unique: ``"backlash"``.

    Raises
    ------
    InputError
        When no effect, or more than one, is called that.
    """
    require_type(model, Model, "model")
    return without_effect(model, name)[0]


def _unfitted(model: Model, terms: list[Term]) -> Model:
    # the covariance belongs to the effects as they were
    return replace(model, terms=tuple(terms), covariance=None)
