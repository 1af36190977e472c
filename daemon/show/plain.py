"""Plain lines for logs and pipes: one every few seconds."""

from __future__ import annotations

import math
from collections.abc import Mapping

from abbe.daemon.guard import DIRECTIONS, GuardState
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.show.figures import volumetric_errors
from abbe.daemon.show.writer import LineWriter
from abbe.daemon.status_word import Status
from abbe.drivers.link import Link

EVERY = 2.0
"""s from one line to the next."""


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
        names = [d for d, s in zip(DIRECTIONS, decision.states, strict=True) if s is state]
        if names:
            return words if len(names) == len(DIRECTIONS) else f"{', '.join(names)}: {words}"
    return "correction limited"


class PlainLines:
    """A listener that writes a line every `EVERY` s.

    Parameters
    ----------
    writer
        Where to.
    links
        Shown with their state.
    axes
        Indices of the corrected axes in a record's positions.
    """

    def __init__(
        self, writer: LineWriter, links: Mapping[str, Link], axes: tuple[int, ...]
    ) -> None:
        self._writer = writer
        self._links = links
        self._axes = axes
        self._due = 0.0

    def __call__(self, record: CycleRecord) -> None:
        """Write a line when it is time."""
        if record.time < self._due:
            return
        self._due = record.time + EVERY
        self._writer.put(self.line(record))

    def line(self, record: CycleRecord) -> str:
        """One cycle in one line."""
        correction = " ".join(
            f"{d} {1e3 * c:+.1f}"
            for d, c in zip(DIRECTIONS, record.decision.correction, strict=True)
        )
        parts = [
            f"{record.time:7.1f} s",
            headline(record),
            f"correction {correction} µm",
        ]
        if (errors := volumetric_errors(record, self._axes)) is not None:
            parts.append(f"error {errors[0]:.1f} → {errors[1]:.1f} µm")
        known = [r.value for r in record.signals.values() if math.isfinite(r.value)]
        if known:
            parts.append(f"signals {min(known):.2f} … {max(known):.2f}")
        parts += [
            f"{name} {link.status.state.value} {1e3 * link.status.round_trip:.2g} ms"
            for name, link in self._links.items()
        ]
        parts.append(f"cycle {1e3 * record.duration:.2g} ms")
        return " | ".join(parts)
