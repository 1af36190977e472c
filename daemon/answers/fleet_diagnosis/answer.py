"""The answer of ``abbe fleet diagnose`` as JSON and as text; lengths µm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_OF_MACHINES = 2
"""Machines from which a cause is listed as one that they share."""


def causes(diagnosis: Mapping[str, Any]) -> list[str]:
    """What a diagnosis names: causes that are missing, and effects that have changed."""
    named = [c["spec"] for c in diagnosis.get("candidates", ()) if not c.get("empirical")]
    return named + [f"changed: {c['spec']}" for c in diagnosis.get("changed", ())]


def shared(found: Sequence[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Cause → the machines that have it, those of most machines first; of two machines or more."""
    machines: dict[str, set[str]] = {}
    for one in found:
        for cause in causes(one):
            machines.setdefault(cause, set()).add(one["machine"])
    several = {c: sorted(m) for c, m in machines.items() if len(m) >= _OF_MACHINES}
    return dict(sorted(several.items(), key=lambda item: (-len(item[1]), item[0])))


def as_json(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """One object for ``--json``."""
    machines = {one["machine"] for one in found}
    return {
        "machines": len(machines),
        "campaigns": [dict(one) for one in found],
        "shared_causes": [{"cause": c, "machines": m} for c, m in shared(found).items()],
    }


def as_text(found: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Lines for people: a campaign each, then what machines have in common."""
    width = max(8, *(len(one["machine"]) for one in found))
    names = max(9, *(len(one["campaign"]) for one in found))
    yield f"{'machine':<{width}}  {'campaign':<{names}}  {'left':>9}  verdict"
    for one in found:
        head = f"{one['machine']:<{width}}  {one['campaign']:<{names}}  "
        if "problem" in one:
            yield f"{head}{'–':>9}  not diagnosed: {one['problem']}"
            continue
        rms = one.get("rms")
        left = "–" if rms is None else f"{rms:.2f} {one['unit'].replace('u', 'µ', 1)}"
        named = "; ".join(causes(one))
        yield f"{head}{left:>9}  {one['verdict']}{': ' + named if named else ''}"
    yield ""
    machines = {one["machine"] for one in found}
    common = shared(found)
    for cause, which in common.items():
        yield f"{cause}: on {len(which)} of {len(machines)} machines ({', '.join(which[:12])})"
    if not common:
        yield f"no cause was named on two of the {len(machines)} machines"
    failed = sum("problem" in one for one in found)
    if failed:
        yield f"{failed} of {len(found)} campaigns could not be diagnosed"
