"""What to measure next after a diagnosis: what would tell causes apart, or sharpen the model."""

from __future__ import annotations

from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.next_measurement.measure_next import Advice, separable
from abbe.compcore.diagnosis.next_measurement.measure_next import advise as _advise
from abbe.compcore.errors import require_type
from abbe.compcore.linalg import threads_for

__all__ = ["Advice", "advise"]

_LEAST = 0.005
"""Part of the model's uncertainty that a measurement takes away to be worth its effort."""


def advise(diagnosis: Findings, most: int = 4) -> list[Advice]:
    """The set-ups that would best tell the leading cause from its aliases, or sharpen the model.

    At the most `most` of them, the most useful first; `diagnosis` is what `diagnose` found.
    """
    require_type(diagnosis, Findings, "diagnosis")
    result = diagnosis.result
    if not result.problem.model.machine.structure.linear:
        return []  # no line that could be measured
    with threads_for(result.problem.n * result.problem.layout.size):
        return _advised(diagnosis, most)


def _advised(diagnosis: Findings, most: int) -> list[Advice]:
    result, left = diagnosis.result, diagnosis.left
    variance = left if left > 0.0 else 1.0  # also where it is NaN
    share = result.problem.n / diagnosis.whole.problem.n
    for established in diagnosis.established:
        effect = established.found.candidate.effect
        rivals = [
            a.found
            for a in established.aliases
            if not a.told_apart and separable(a.found.candidate.effect)
        ]
        if rivals and separable(effect):
            others = [e.found for e in diagnosis.established if e is not established]
            found = _advise(
                result, established.found, rivals, most,
                beside=others, variance=variance, share=share,
            )  # fmt: skip
            if any(a.separates for a in found):
                return found
    return [a for a in _advise(result, None, (), most) if _worth(a)]


def _worth(advice: Advice) -> bool:
    return advice.uncertainty_falls_by >= _LEAST
