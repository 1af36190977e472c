"""The last cycle of a run, and the last one whose positions were sound."""

from __future__ import annotations

from abbe.daemon.pipeline.record import CycleRecord


class LastCycles:
    """A listener that keeps two records, for those who ask later.

    Attributes
    ----------
    latest
        The last record; None before the first cycle.
    sound
        The last one in which every axis's position was to be believed; None before the first.
    """

    def __init__(self) -> None:
        self.latest: CycleRecord | None = None
        self.sound: CycleRecord | None = None

    def __call__(self, record: CycleRecord) -> None:
        """Keep a cycle's record."""
        self.latest = record
        if not record.faults:
            self.sound = record
            return
        whole = sum(record.indicated)
        if whole == whole:  # no axis is NaN
            self.sound = record
