"""A run's records: a listener of the cycle and of the journal that hands them to the writer."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence

from abbe.compcore.machine.conditions import unit_of
from abbe.compcore.machine.machine import Machine
from abbe.daemon.config.identity import RunIdentity
from abbe.daemon.guard import DIRECTIONS
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.records.writer import EventRow, RecordWriter, RunRow, Value

IN_FULL = "in_full"
"""Series: 1 where every direction was corrected in full and the controller took it, else 0."""
BEYOND = "beyond_"
"""How series begin that say how far something was outside of what was measured, with its sign."""
_MILLI = 1e3


class Recorder(logging.Handler):
    """Keeps one cycle in so many seconds, every change of the status word, and every event.

    Parameters
    ----------
    writer
        Takes the records.
    machine
        The model's.
    axes, corrected_axes
        As the pipeline has them.
    every
        s from one cycle that is kept to the next.
    clock
        s since 1970.
    sure
        Says how sure the correction is.
    """

    def __init__(
        self,
        writer: RecordWriter,
        machine: Machine,
        axes: Sequence[str],
        corrected_axes: Sequence[str],
        every: float,
        clock: Callable[[], float] = time.time,
        sure: LiveUncertainty | None = None,
    ) -> None:
        super().__init__(logging.INFO)
        self._writer = writer
        self._every = every
        self._clock = clock
        self._sure = sure
        self._units = {name: unit_of(name) for name in axes}
        self._indicated = [(f"indicated_{axis}", self._units[axis]) for axis in axes]
        self._corrected = [
            (axes.index(axis), f"correction_{axis}", self._units[axis]) for axis in corrected_axes
        ]
        self._signals = {name: signal.unit for name, signal in machine.signals.items()}
        self._due = -math.inf
        self._status = -1

    def began(self, identity: RunIdentity, machine: str) -> None:
        """A run begins, or goes on with another model."""
        (config, config_sha), (model, model_sha) = identity.files[:2]
        self._writer.put(
            RunRow(
                self._clock(),
                identity.version,
                str(config),
                config_sha,
                str(model),
                model_sha,
                machine,
            )
        )

    def __call__(self, record: CycleRecord) -> None:
        """Keep a cycle when it is time, or when the status word has changed."""
        if record.time < self._due and record.status == self._status:
            return
        if record.time >= self._due:
            self._due = record.time + self._every
        self._status = record.status
        now = self._clock()
        values: list[Value] = [("status", "", now, float(record.status))]
        # a word of bits cannot be thinned to a mean; a share can
        values.append((IN_FULL, "", now, float(record.in_full)))
        values.append(("cycle", "ms", now, record.duration * _MILLI))
        values.append(("age", "ms", now, record.age * _MILLI))
        for (name, unit), value in zip(self._indicated, record.indicated, strict=True):
            if math.isfinite(value):
                values.append((name, unit, now, value))
        for (at, name, unit), corrected in zip(self._corrected, record.corrected, strict=True):
            value = corrected - record.indicated[at]
            if math.isfinite(value):
                values.append((name, unit, now, value))
        if self._sure is not None and (latest := self._sure.latest) is not None:
            wide = zip(DIRECTIONS, latest.wide, strict=True)
            values += [(f"plus_minus_{d}", "mm", now, w) for d, w in wide]
            values.append(("outside", "", now, float(self._sure.outside)))
            values += [
                (f"{BEYOND}{b.name}", b.unit, now, b.value - min(max(b.value, b.low), b.high))
                for b in latest.beyond
            ]
        for name, reading in record.signals.items():
            if math.isfinite(reading.value) and not reading.fault:
                values.append((name, self._signals.get(name, ""), now, reading.value))
        self._writer.put(values)

    def keep(self, name: str, unit: str, value: float) -> None:
        """Keep one value of now."""
        self._writer.put([(name, unit, self._clock(), value)])

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one event."""
        try:
            message = record.getMessage()
        except Exception:  # noqa: BLE001  (as logging's own handlers: the event is at fault)
            self.handleError(record)
            return
        self._writer.put(EventRow(record.created, record.levelname, record.name, message))
