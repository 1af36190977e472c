"""The state of the correction in a few words, for screens, lines and the service manager."""

from __future__ import annotations

from collections.abc import Sequence

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
ENDED = "ended, not corrected"
"""The state of a correction that was asked to end, and has."""
_COMPUTED_ONLY = "computed, not written"
_NOTHING_COMPUTED = {**_WORDS, GuardState.OFF: "no correction"}


def headline(record: CycleRecord) -> str:
    """The state in a few words: the gravest, with its directions where it is not all of them.

    Where corrected positions are not written, that is said first: nothing is corrected there.
    """
    decision = record.decision
    if record.status & Status.ENDING:
        off = set(decision.states) == {GuardState.OFF}
        if off:
            return ENDED
        return "ending: correction ramped to zero" if record.writes else f"ending: {_COMPUTED_ONLY}"
    if not record.writes:
        why = _gravest(record, _NOTHING_COMPUTED) or _limited(record)
        return f"{_COMPUTED_ONLY} ({why})" if why else _COMPUTED_ONLY
    if record.in_full:
        return "corrected in full"
    return (
        _gravest(record, _WORDS)
        or _limited(record)
        or f"{_named(record, _not_taken(record))}correction not taken by the controller"
    )


def _gravest(record: CycleRecord, words: dict[GuardState, str]) -> str:
    """Words for the gravest of the guard's states; empty where it hands out everything."""
    for state, text in words.items():
        names = [
            d for d, s in zip(record.directions, record.decision.states, strict=True) if s is state
        ]
        if names:
            return _named(record, names) + text
    return ""


def _limited(record: CycleRecord) -> str:
    """Words for a correction that is cut or behind; empty where none is."""
    decision = record.decision
    if decision.compensating:
        return ""
    names = [d for i, d in enumerate(record.directions) if decision.limited >> i & 1]
    return _named(record, names) + "correction limited"


def _not_taken(record: CycleRecord) -> list[str]:
    """Those of X, Y and Z of which the status word says that they are not corrected in full."""
    bits = (Status.X_ACTIVE, Status.Y_ACTIVE, Status.Z_ACTIVE)
    return [d for d, bit in zip(record.directions, bits, strict=False) if not record.status & bit]


def _named(record: CycleRecord, names: Sequence[str]) -> str:
    """``X, Y: `` where it is some of the directions; empty where it is all, or not known."""
    return f"{', '.join(names)}: " if 0 < len(names) < len(record.directions) else ""
