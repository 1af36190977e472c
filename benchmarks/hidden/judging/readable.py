"""Whether the largest terms of a sparse regression tell what is hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.hidden.causes.cause import Cause
from benchmarks.hidden.judging.inputs import Term

_LINEAR = "XYZ"


def readable(terms: Sequence[Term], causes: Sequence[Cause]) -> str:
    """Whether as many of the largest terms as there are causes name every cause.

    ``yes``, ``no``, ``–`` where nothing is hidden.
    """
    if not causes:
        return "–"
    leading = _distinct(terms)[: len(causes)]
    named = all(any(_says(term, cause) for term in leading) for cause in causes)
    return "yes" if named else "no"


def _distinct(terms: Sequence[Term]) -> list[Term]:
    """Without those of the same quantities as one before."""
    found: dict[tuple[frozenset[str], str], Term] = {}
    for term in terms:
        found.setdefault((_quantities(term), term.component), term)
    return list(found.values())


def _quantities(term: Term) -> frozenset[str]:
    """What a term depends on; sine and cosine of a rotary axis count as the axis."""
    return frozenset(q.removeprefix("sin ").removeprefix("cos ") for q in term.quantities)


def _says(term: Term, cause: Cause) -> bool:
    """Whether a term has a cause's own quantities and, where it is known, its direction.

    Through an angle also a lever, a position or a tool offset; a course in time may be a power.
    """
    found = _quantities(term)
    if not cause.answers:
        return found == set(cause.depends)
    return any(_is(found, term.component, kind, where) for kind, where in cause.answers)


def _is(found: frozenset[str], component: str, kind: str, where: Mapping[str, Any]) -> bool:
    axis = str(where.get("axis", ""))
    if kind == "length_bias":
        base = where.get("base")
        return found == ({f"from {base}"} if base else {"distance"})
    if kind == "squareness":
        one, two = where["axes"]
        return (found, component) in (({one}, two), ({two}, one))
    wanted = [set(w) for w in _depends(kind, axis, where)]
    turns = "about" in where or (
        axis != "" and axis[0] in "ABC" and kind not in ("rotary_radial", "rotary_axial")
    )
    levers = set(_LINEAR) if turns else set()
    if not any(w <= found and found <= w | levers for w in wanted):
        return False
    if kind in ("workpiece_expansion", "air_refraction"):
        return component in found
    towards = set(_LINEAR)
    if "about" in where or kind == "rotary_tilt":
        towards -= {str(where.get("about", where.get("direction")))}
    elif "direction" in where:
        towards = {str(where["direction"])}
    elif axis in _LINEAR:
        towards = {axis}
    return component in towards


def _depends(kind: str, axis: str, where: Mapping[str, Any]) -> list[list[str]]:
    """Recorded quantities of a kind of effect; empty where no product of them tells it."""
    signals = [str(s) for s in where.get("signals", ())] + [str(where.get("signal", ""))]
    signals = [s for s in signals if s]
    by = str(where.get("by", ""))
    if kind in ("positioning", "scale", "straightness", "angular"):
        return [[axis]]
    if kind.startswith("rotary_"):
        return [[axis]]
    if kind in ("backlash", "reversal_angle"):
        return [[f"{axis}_dir"], [f"{axis}_dir", axis]]
    if kind == "feed_lag":
        return [[f"{axis}_dir", s] for s in signals]
    if kind in ("cross_angular", "overhang_sag"):
        return [[by], [by, axis]] if by else []
    if kind in ("scale_expansion", "screw_heating", "thermal_bending"):
        return [[axis, s] for s in signals]
    if kind in ("thermal_offset", "thermal_tilt"):
        return [[s] for s in signals]
    if kind == "load_bending":
        return [[s] for s in signals] + [[s, axis] for s in signals]
    if kind in ("warm_up", "drift", "event"):
        return [["t"]]
    if kind in ("workpiece_expansion", "air_refraction"):
        return [[a, s] for a in _LINEAR for s in signals or ["T_amb"]]
    return []
