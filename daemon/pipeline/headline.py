"""The state of the correction in a few words, for screens, lines and the service manager."""

from __future__ import annotations

from abbe.daemon.guard import GuardState
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.status_word import Status

_WORDS = {
    GuardState.OFF: "NOT CORRECTED",
    GuardState.FALLING: "correction ramped to zero",
    GuardState.HOLDING: "last good correction held",
    GuardState.RISING: "correction ramped in",
}
"""Gravest first."""


def headline(record: CycleRecord) -> str:
    """The state in a few words: the gravest, with its directions where it is not all of them."""
    decision = record.decision
    if record.status & Status.ENDING:
        off = set(decision.states) == {GuardState.OFF}
        return "ended, not corrected" if off else "ending: correction ramped to zero"
    if decision.compensating:
        return "corrected in full"
    for state, words in _WORDS.items():
        names = [d for d, s in zip(record.directions, decision.states, strict=True) if s is state]
        if names:
            return words if len(names) == len(record.directions) else f"{', '.join(names)}: {words}"
    return "correction limited"
