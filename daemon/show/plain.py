"""Plain lines for logs and pipes: one every few seconds."""

from __future__ import annotations

import time
from collections.abc import Mapping

from abbe.compcore.units import in_digits
from abbe.daemon.pipeline.headline import headline
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.show.writer import LineWriter
from abbe.daemon.status.ages import age_in_words
from abbe.daemon.status.figures import volumetric_errors
from abbe.drivers.link import Link

EVERY = 2.0
"""s from one line to the next."""


class PlainLines:
    """A listener that writes a line every `EVERY` s.

    Parameters
    ----------
    writer
        Where to.
    links
        Shown with their state.
    axes
        Indices of the corrected linear axes in a record's positions.
    sure
        Says how sure the correction is.
    """

    def __init__(
        self,
        writer: LineWriter,
        links: Mapping[str, Link],
        axes: tuple[int, ...],
        sure: LiveUncertainty | None = None,
    ) -> None:
        self._writer = writer
        self._sure = sure
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
        amounts = list(zip(record.directions, record.decision.correction, strict=True))
        correction = " ".join(f"{d} {1e3 * c:+.1f}" for d, c in amounts[:3]) + " µm"
        if turns := " ".join(f"{d} {1e6 * c:+.1f}" for d, c in amounts[3:]):
            correction += f" {turns} µrad"
        if self._sure is not None and (latest := self._sure.latest) is not None:
            wide = ", ".join(f"{1e3 * w:.1f}" for w in latest.wide)
            correction += f" (± {wide})"
        parts = [
            f"{record.time:7.1f} s",
            headline(record),
            f"correction {correction}",
        ]
        if record.shown is not None:
            shown = " ".join(
                f"{d} {1e3 * c:+.1f}" for d, c in zip("XYZ", record.shown, strict=True)
            )
            parts.append(f"only shown {shown} µm")
        if record.pose is not None and (record.pose.damped or record.pose.limited):
            parts.append(f"{1e6 * record.pose.direction_left:.1f} µrad of the tool's lean left")
        if (errors := volumetric_errors(record, self._axes)) is not None:
            parts.append(f"error {errors[0]:.1f} → {errors[1]:.1f} µm")
        known = [r.value for r in record.signals.values() if not r.fault]
        if known:
            parts.append(f"signals {min(known):.2f} … {max(known):.2f}")
        now = time.monotonic()
        parts += [
            f"{name} stale, {age_in_words(now - reading.time) or 'never read'}"
            for name, reading in record.signals.items()
            if reading.fault
        ]
        parts += [
            f"{name} {link.status.state.value} {in_digits(1e3 * link.status.round_trip, 2)} ms"
            for name, link in self._links.items()
        ]
        parts.append(f"cycle {in_digits(1e3 * record.duration, 2)} ms")
        return " | ".join(parts)
