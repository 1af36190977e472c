"""Whether a diagnosis named what was hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from abbe.compcore.diagnosis import Diagnosis
from abbe.compcore.diagnosis.judging.aliases import CERTAINLY_APART
from abbe.compcore.diagnosis.screening.pool import WeighedCandidate
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.base import Effect
from abbe.compcore.model.revise import identity
from benchmarks.hidden.causes.cause import Cause


def score(diagnosis: Diagnosis, causes: Sequence[Cause]) -> str:
    """One of these words.

    ``named``; ``alias``: not first, but among what was declared confusable, and the truth explains
    no more than what was named; ``separable alias``: it explains more; ``one of two``, ``wrong``,
    ``missed``; ``too small``: nothing said, and who knows the truth finds no evidence for it
    either. Nothing hidden: ``right``, ``false alarm``. For what is in no catalogue ``described``,
    ``described wrongly``, ``named a cause`` or ``missed``.
    """
    if not causes:
        return "right" if diagnosis.verdict == "complete" else "false alarm"
    known = [c for c in causes if c.answers]
    if len(known) > 1:
        # of several, those that can be seen at all
        seen = [c for c in known if any(f.evidence.value > 0.0 for f in _true(diagnosis, c))]
        known = seen or known
    if not known:
        if diagnosis.verdict == "complete":
            return "missed"
        if diagnosis.verdict == "missing":
            return "named a cause"
        described = {name for s in diagnosis.structure for name in s.depends_on}
        return "described" if set(causes[0].depends) & described else "described wrongly"
    if not diagnosis.established:
        visible = any(f.established(diagnosis.basis.n) for c in known for f in _true(diagnosis, c))
        return "missed" if visible or diagnosis.verdict != "complete" else "too small"
    named = [e.found.candidate.effect for e in diagnosis.established]
    if all(any(_answers(e, c) for e in named[: len(causes)]) for c in known) and any(
        _answers(named[0], c) for c in known
    ):
        return "named"
    aliases = {identity(a.found.candidate.effect) for e in diagnosis.established for a in e.aliases}
    wanted = [identity(make_effect(k, w)) for c in known for k, w in c.answers]
    if any(w in aliases for w in wanted):
        return "alias" if len(known) > 1 or _inseparable(diagnosis, known[0]) else "separable alias"
    return "one of two" if any(_answers(named[0], c) for c in known) else "wrong"


def _answers(effect: Effect, cause: Cause) -> bool:
    """Whether an effect names a cause: the kind and every where-key that the answer has."""
    for kind, where in cause.answers:
        if effect.kind == kind:
            own: Mapping[str, Any] = effect.where()
            if all(_same(own.get(k), v) for k, v in where.items()):
                return True
    return False


def _same(found: object, wanted: object) -> bool:
    if isinstance(found, list) and isinstance(wanted, list):
        return sorted(map(str, found)) == sorted(map(str, wanted))
    return str(found) == str(wanted)


def _true(diagnosis: Diagnosis, cause: Cause) -> list[WeighedCandidate]:
    """The true cause as the data see it by itself, its non-linear parameters at their best."""
    pool, basis = diagnosis.pool, diagnosis.basis
    found = [f for f in diagnosis.ranked if _answers(f.candidate.effect, cause)]
    return [pool.refined(basis, f) for f in found]


def _inseparable(diagnosis: Diagnosis, cause: Cause) -> bool:
    """Whether the true cause explains no more of this campaign than what was named."""
    drop = max((f.screened.drop for f in _true(diagnosis, cause)), default=0.0)
    explained = diagnosis.basis.chi2 - diagnosis.left * diagnosis.basis.dof
    return drop - explained < CERTAINLY_APART * diagnosis.left
