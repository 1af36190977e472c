"""Packing of cycles for the HTTP process: some microseconds each, and only while somebody asks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from abbe.daemon.guard import GuardState
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.daemon.pipeline.record import CycleRecord


class CyclePacker:
    """Makes of a record what can be sent; what seldom changes is sent when it has changed."""

    def __init__(self) -> None:
        self._states: tuple[GuardState, ...] | None = None
        self._words: tuple[str, ...] = ()
        self._signals: Mapping[str, SignalReading] | None = None

    def begin(self) -> None:
        """Send everything with the next cycle."""
        self._signals = None

    def __call__(self, record: CycleRecord, dropped: int) -> tuple[Any, ...]:
        """The parts of a `Cycle`; `dropped` are those before it that were not sent."""
        decision = record.decision
        if decision.states is not self._states:
            self._states = decision.states
            self._words = tuple(state.value for state in decision.states)
        signals = None
        if record.signals is not self._signals:
            self._signals = record.signals
            signals = {n: (r.value, not r.fault) for n, r in record.signals.items()}
        return (
            record.number,
            record.time,
            record.indicated,
            record.corrected,
            decision.correction,
            self._words,
            record.status,
            record.in_full,
            record.duration,
            record.age,
            signals,
            dict(record.faults),
            dropped,
        )
