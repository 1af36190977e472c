"""The logbook of a run: what its status says of the time before it was asked for."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from abbe.compcore.machine.machine import Machine
from abbe.daemon.config.identity import RunIdentity
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.status.figures import Figures
from abbe.daemon.status.last_cycles import LastCycles
from abbe.daemon.status.recent_events import RecentEvents


class Logbook:
    """Listens to the pipeline, and to the journal while it is `open`.

    Parameters
    ----------
    pipeline
        What runs.
    machine
        The model's.
    holds
        What no other Abbe may write to meanwhile.

    Attributes
    ----------
    figures, cycles, events
        Of the run so far.
    holds
        As given.
    started
        s since 1970; 0 before the run.
    changed_files
        Files that were not what runs any more when they were looked at last.
    """

    def __init__(self, pipeline: Pipeline, machine: Machine, holds: Sequence[str]) -> None:
        linear = [axis for axis in pipeline.corrected_axes if not machine.axes[axis].rotary]
        self.figures = Figures(tuple(pipeline.axes.index(axis) for axis in linear))
        self.cycles, self.events = LastCycles(), RecentEvents()
        self.holds = tuple(holds)
        self.started = 0.0
        self.changed_files: tuple[Path, ...] = ()
        self._looking: asyncio.Task[tuple[Path, ...]] | None = None
        pipeline.listeners.extend([self.cycles, self.figures])

    @contextmanager
    def open(self) -> Iterator[None]:
        """The run begins; it is over when the context is."""
        self.started = time.time()
        journal = logging.getLogger("abbe")
        journal.addHandler(self.events)
        try:
            yield
        finally:
            journal.removeHandler(self.events)

    async def look_at_files(self, identity: RunIdentity) -> tuple[Path, ...]:
        """Files on disk that are not what runs any more; one look at a time, however many ask."""
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(asyncio.to_thread(identity.changed))
        self.changed_files = await asyncio.shield(self._looking)
        return self.changed_files
