"""The status of a running service: what it is at this moment, made only when somebody asks."""

from __future__ import annotations

import logging
import math
import os
import pwd
import socket
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Literal, Protocol

from abbe.compcore.model.model import Model
from abbe.daemon.config import Configuration
from abbe.daemon.config.channels import split
from abbe.daemon.config.identity import RunIdentity
from abbe.daemon.guard import DIRECTIONS
from abbe.daemon.pipeline.compensate import direction_index
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.pipeline.headline import ENDED, headline
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.status.check_status import check_status
from abbe.daemon.status.live_checks import AskedChecks
from abbe.daemon.status.logbook import Logbook
from abbe.daemon.status.run_status import (
    AxisStatus,
    CycleStatus,
    LinkHealth,
    RunningFile,
    RunOwner,
    RunStatus,
    SignalStatus,
    StatusEvent,
    StatusWord,
)
from abbe.daemon.status_word import Status, describe
from abbe.drivers.link import Link, LinkState

_HANGS = 2.0
"""s, beside some periods, after which a cycle that has not come round is reported as hanging."""
_PERIODS = 4.0
_MICRO, _MILLI = 1e6, 1e3
_LIMITS_MS = ("0.5", "1", "2", "5", "10", "20", "50", "100", "200", "500", "1000")
_LIMITS = tuple(float(limit) / _MILLI for limit in _LIMITS_MS)
_CARRIES = (LinkState.UP, LinkState.DEGRADED)


class ObservedService(Protocol):
    """A service, as far as its status needs it."""

    configuration: Configuration
    identity: RunIdentity
    pipeline: Pipeline
    links: dict[str, Link]
    uncertainty: LiveUncertainty
    logbook: Logbook

    @property
    def checks(self) -> AskedChecks:
        """Its check points."""


class StatusSource:
    """Makes the status of a service; a call takes some tenths of a millisecond.

    Parameters
    ----------
    service
        What runs.
    """

    def __init__(self, service: ObservedService) -> None:
        self._service = service
        self._host = socket.gethostname()
        self._user = _user()
        self._model: Model | None = None
        self._switches: dict[str, str] = {}

    def __call__(self) -> RunStatus:
        """The status now."""
        service = self._service
        now = time.monotonic()
        record = service.logbook.cycles.latest
        file = service.configuration.file
        machine = service.configuration.model.machine
        cycle = self._cycle(record, now)
        hangs = _HANGS + _PERIODS * file.cycle.period
        alive = cycle.age_s is not None and cycle.age_s < hangs
        state = "waiting for the first cycle"
        if record is not None:
            state = headline(record)
            if not alive and state != ENDED:
                state = f"the cycle hangs since {cycle.age_s:.0f} s; before: {state}"
        sure = service.uncertainty.latest
        return RunStatus(
            abbe=service.identity.version,
            machine=machine.name,
            at=datetime.now().astimezone(),
            state=state,
            in_full=alive and record is not None and record.in_full,
            computed_in_full=alive and record is not None and record.decision.compensating,
            alive=alive,
            ending=record is not None and bool(record.status & Status.ENDING),
            writes=bool(file.output.axes),
            cycle=cycle,
            status_word=_word(0 if record is None else record.status),
            axes=self._axes(record, now),
            signals=self._signals(record, now),
            links=self._links(now),
            faults={} if record is None else dict(record.faults),
            beyond=[] if sure is None else [str(b) for b in sure.beyond],
            outside=[] if sure is None else [b.name for b in sure.beyond],
            checks=check_status(service.checks.state) if service.checks.wanted else None,
            tool_mm=service.pipeline.tool,
            switches=self._switched(),
            files=self._files(),
            owner=RunOwner(
                user=self._user,
                pid=os.getpid(),
                host=self._host,
                since=_moment(service.logbook.started),
                holds=list(service.logbook.holds),
            ),
            event_counts=dict(service.logbook.events.counts),
            events=[
                StatusEvent(
                    time=_moment(e.time), level=logging.getLevelName(e.level).lower(), text=e.text
                )
                for e in tuple(service.logbook.events.events)
            ],
        )

    def _switched(self) -> dict[str, str]:
        """Every compensation's switch; worked out once for each model."""
        model = self._service.configuration.model
        if model is not self._model:
            self._model, self._switches = model, dict(model.switches)
        return self._switches

    def _cycle(self, record: CycleRecord | None, now: float) -> CycleStatus:
        service = self._service
        began = service.pipeline.began
        figures = service.logbook.figures
        return CycleStatus(
            number=0 if record is None else record.number,
            running_s=round(now - began, 3),
            age_s=None if record is None else _age(now - began - record.time),
            period_ms=_MILLI * service.configuration.file.cycle.period,
            last_ms=None if record is None else _known(_MILLI * record.duration, 3),
            median_ms=_known(figures.cycle_ms(0.5), 3),
            p99_ms=_known(figures.cycle_ms(0.99), 3),
            total_s=round(figures.durations.seconds, 6),
            within_ms=dict(zip(_LIMITS_MS, figures.durations.within(_LIMITS), strict=True)),
            missed=service.pipeline.missed,
            position_age_ms=None if record is None else _known(_MILLI * record.age, 3),
        )

    def _axes(self, record: CycleRecord | None, now: float) -> dict[str, AxisStatus]:
        pipeline = self._service.pipeline
        sound, began = self._service.logbook.cycles.sound, pipeline.began
        found = {}
        for i, axis in enumerate(pipeline.axes):
            indicated = math.nan if record is None else record.indicated[i]
            stale = not math.isfinite(indicated)
            last = sound if stale else record
            age = None if last is None else _age(now - began - last.time + last.age)
            found[axis] = self._axis(
                axis,
                record,
                indicated=math.nan if last is None else last.indicated[i],
                stale=stale,
                age=age,
                reference=math.nan if record is None else record.reference[i],
            )
        return dict(sorted(found.items()))

    def _axis(
        self,
        axis: str,
        record: CycleRecord | None,
        *,
        indicated: float,
        stale: bool,
        age: float | None,
        reference: float,
    ) -> AxisStatus:
        service = self._service
        pipeline, file = service.pipeline, service.configuration.file
        rotary = service.configuration.model.machine.axes[axis].rotary
        factor = math.degrees(1.0) if rotary else 1.0
        corrected = amount = wide = math.nan
        guard: Literal["off", "rising", "active", "holding", "falling"] | None = None
        if record is not None and axis in pipeline.corrected_axes:
            k = direction_index(axis, record.directions)
            corrected = record.corrected[pipeline.corrected_axes.index(axis)]
            amount = record.decision.correction[k]
            guard = record.decision.states[k].value
        if (sure := service.uncertainty.latest) is not None and axis in DIRECTIONS:
            wide = sure.wide[DIRECTIONS.index(axis)]
        return AxisStatus(
            unit="deg" if rotary else "mm",
            indicated=_known(indicated * factor),
            corrected=_known(corrected * factor),
            stale=stale,
            age_s=age,
            fault=self._axis_fault(axis, record) if stale else "",
            correction=_known(amount * (_MICRO if rotary else _MILLI), 4),
            correction_unit="urad" if rotary else "um",
            uncertainty=None if guard is None else _known(_MILLI * wide, 4),
            guard=guard,
            written=axis in file.output.axes,
            reference=_known(reference * factor),
        )

    def _axis_fault(self, axis: str, record: CycleRecord | None) -> str:
        """Why an axis has no sound position: by itself, or because its link is down."""
        own = "not read yet" if record is None else record.faults.get(f"axis {axis}", "")
        source = self._service.configuration.file.axes[axis].source
        return self._lost(source) or own or "its position is not to be believed"

    def _lost(self, channel: str | None) -> str:
        """The state of a channel's link, where it carries nothing; empty where it does."""
        if channel is None:
            return ""
        link = split(channel)[0]
        state = self._service.links[link].status.state
        return "" if state in _CARRIES else f"link {link} is {state.value}"

    def _signals(self, record: CycleRecord | None, now: float) -> dict[str, SignalStatus]:
        if record is None:
            return {}
        machine = self._service.configuration.model.machine
        sections = self._service.configuration.file.signals
        found = {}
        for name, reading in record.signals.items():
            fault = self._lost(sections[name].source) or reading.fault
            found[name] = SignalStatus(
                value=_known(reading.value),
                unit=machine.signals[name].unit,
                temperature=machine.signals[name].temperature,
                stale=bool(fault),
                age_s=_age(now - reading.time),
                fault=fault,
                typed_in=sections[name].source is None,
            )
        return found

    def _links(self, now: float) -> dict[str, LinkHealth]:
        setups = self._service.configuration.links
        found = {}
        for name, link in self._service.links.items():
            status = link.status
            found[name] = LinkHealth(
                driver=setups[name].driver,
                state=status.state.value,
                for_s=round(max(0.0, now - status.since), 3),
                detail=status.detail,
                round_trip_ms=_known(_MILLI * status.round_trip, 3),
                requests=status.requests,
                failures=status.failures,
                reconnects=status.reconnects,
                quarantined=dict(status.quarantined),
            )
        return found

    def _files(self) -> list[RunningFile]:
        service = self._service
        roles: Sequence[Literal["configuration", "model"]] = ("configuration", "model")
        return [
            RunningFile(
                role=roles[i] if i < len(roles) else "grid",
                path=str(path.absolute()),
                sha256=digest,
                differs=path in service.logbook.changed_files,
            )
            for i, (path, digest) in enumerate(service.identity.files)
        ]


def _word(word: int) -> StatusWord:
    return StatusWord(word=word, bits=describe(word).split())


def _known(value: float, digits: int = 6) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _age(seconds: float) -> float | None:
    return _known(max(0.0, seconds), 3)


def _moment(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC).astimezone()


def _user() -> str:
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:  # a user number without a name
        return str(os.geteuid())
