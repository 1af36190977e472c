"""Single compensations that are off, or only shown: what is said of them beside an answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.days import of_their_day
from abbe.compcore.model.model import Model


def shown_parts(
    model: Model, at: Callable[[Model], Conditions]
) -> dict[str, tuple[float, float, float] | None]:
    """What each effect that is only shown would give, as moves of X, Y, Z, mm.

    Parameters
    ----------
    model
        The whole model.
    at
        The conditions of one point for a part of it; raises `InputError` where a signal is missing.

    Returns
    -------
    Spec → moves; None where a signal that it reads is not stated.
    """
    found: dict[str, tuple[float, float, float] | None] = {}
    only = model.switched("shown")
    for term in only.terms:
        part = Model(model.machine, (term,), model.composition)
        if not term.fitted or term.effect.scope == "instrument":
            continue
        try:
            moves = part.axis_error(at(part))
        except InputError:
            found[term.effect.spec] = None
            continue
        x, y, z = (float(np.asarray(moves[a])[0]) for a in "XYZ")
        found[term.effect.spec] = x, y, z
    return found


def not_applied(model: Model) -> list[str]:
    """What is off or only shown, for people, without its size."""
    return [
        f"{name} is {'off' if switch == 'off' else 'only shown'} and not applied"
        for name, switch in model.switches.items()
        if switch != "on"
    ] + of_their_day(model)


def names_off(model: Model) -> list[str]:
    """Effects, and tables of effects, that are off."""
    return [name for name, switch in model.switches.items() if switch == "off"]


def notes(model: Model, parts: Mapping[str, tuple[float, float, float] | None]) -> list[str]:
    """What is not applied, for people."""
    said = [f"{name} is off and not applied" for name in names_off(model)]
    said += of_their_day(model)
    for spec, moves in parts.items():
        if moves is None:
            said.append(f"{spec} is only shown, and a signal that it reads is not stated")
        else:
            size = ", ".join(f"{a} {m * 1e3:+.2f}" for a, m in zip("XYZ", moves, strict=True))
            said.append(f"{spec} is only shown and not applied: {size} µm")
    return said


def switches_json(
    model: Model, parts: Mapping[str, tuple[float, float, float] | None]
) -> dict[str, Any]:
    """``off`` and ``shown`` for ``--json``, mm; nothing where all is on."""
    off = names_off(model)
    if not off and not parts:
        return {}
    shown = {
        spec: None if moves is None else dict(zip("XYZ", moves, strict=True))
        for spec, moves in parts.items()
    }
    return {"off": off, "shown": shown}
