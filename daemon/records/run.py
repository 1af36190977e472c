"""Records of one run: begun with it, ended with it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from abbe.daemon.config import Configuration
from abbe.daemon.config.identity import RunIdentity
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.records.recorder import Recorder
from abbe.daemon.records.thinning import Retention
from abbe.daemon.records.writer import RecordWriter


@contextmanager
def recorded(
    configuration: Configuration,
    pipeline: Pipeline,
    identity: RunIdentity,
    sure: LiveUncertainty | None = None,
) -> Iterator[Recorder | None]:
    """Keep records while the context lasts; None where the configuration wants none."""
    section, path = configuration.file.records, configuration.records_path
    if section is None or path is None:
        yield None
        return
    retention = Retention(
        section.full_days, section.minute_days, section.hour_days, section.max_bytes
    )
    writer = RecordWriter(path, retention)
    machine = configuration.model.machine
    axes = pipeline.axes, pipeline.corrected_axes
    recorder = Recorder(writer, machine, *axes, section.every, sure=sure)
    recorder.began(identity, machine.name)
    journal = logging.getLogger("abbe")
    pipeline.listeners.append(recorder)
    journal.addHandler(recorder)
    try:
        yield recorder
    finally:
        journal.removeHandler(recorder)
        if recorder in pipeline.listeners:
            pipeline.listeners.remove(recorder)
        writer.close()
