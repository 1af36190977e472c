"""Controls of a running correction: what each request does, and what the journal says of it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

from abbe.compcore.errors import InputError
from abbe.compcore.machine.plausible import position_range
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Switch
from abbe.daemon.control.live_switches import changed_live, until_words
from abbe.daemon.control.requests import (
    DatumRequest,
    EnterRequest,
    Request,
    StatusRequest,
    SwitchRequest,
)
from abbe.daemon.pipeline.compensate import LiveCompensator
from abbe.daemon.pipeline.reading.expected import expected_of
from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.status.status_source import ObservedService, StatusSource

logger = logging.getLogger("abbe.control")

_WITHIN = 5.0
"""s in which an axis has to have stood still for its datum."""
_LOOK = 1.0
"""s for a look at the files that the run was made from."""


class ControlledService(ObservedService, Protocol):
    """A service, as far as its controls need it."""

    switches_in_file: Mapping[str, Switch]


class Controls:
    """Does what is asked, one after the other.

    Parameters
    ----------
    service
        What runs.

    Attributes
    ----------
    status_now
        Makes the run's status.
    """

    def __init__(self, service: ControlledService) -> None:
        self._service = service
        self.status_now = StatusSource(service)
        self._one_by_one = asyncio.Lock()

    async def __call__(self, request: Request, who: str) -> dict[str, Any]:
        """Do what is asked.

        Parameters
        ----------
        request
            What.
        who
            By whom, for the journal.

        Raises
        ------
        InputError
            For what cannot be; nothing has changed then.
        """
        if isinstance(request, StatusRequest):
            return {"status": (await self.status()).model_dump(mode="json")}
        async with self._one_by_one:
            said = ""
            if isinstance(request, SwitchRequest):
                said = await self._switch(request)
            elif isinstance(request, EnterRequest):
                said = self._enter(request)
            elif isinstance(request, DatumRequest):
                said = await self._datum(request)
            if said:
                logger.warning("%s, by %s", said, who)
            return {"said": said, **self._state()}

    async def status(self) -> RunStatus:
        """All that the run says of itself, with a fresh look at its files."""
        with contextlib.suppress(TimeoutError):  # a file server that is away keeps nobody waiting
            async with asyncio.timeout(_LOOK):
                await self._service.logbook.look_at_files(self._service.identity)
        return self.status_now()

    async def _switch(self, request: SwitchRequest) -> str:
        service = self._service
        running = service.configuration
        model = running.model.with_switch(request.effect, request.to, request.table)
        if model == running.model:
            return ""
        compensation = await asyncio.to_thread(LiveCompensator, model, running.limits.turning)
        if service.configuration is not running:
            raise InputError("the configuration was reloaded meanwhile; nothing was switched")
        changed = replace(running, model=model)
        pipeline = service.pipeline
        expected = expected_of(changed, compensation.axes, pipeline.links)
        pipeline.change_model(changed, compensation, expected)
        before = running.model.switches
        words = [
            f"{name} is {switch} (was {before.get(name, 'as its effect')})"
            for name, switch in model.switches.items()
            if before.get(name) != switch
        ]
        service.configuration = changed
        return "compensation: " + "; ".join(words)

    def _enter(self, request: EnterRequest) -> str:
        signals = self._service.configuration.model.machine.signals
        good_for = self._service.pipeline.enter(request.signal, request.value, request.seconds)
        unit = signals[request.signal].unit
        return f"{request.signal} = {request.value:g} {unit} typed in, for {good_for:g} s"

    async def _datum(self, request: DatumRequest) -> str:
        axis, machine = request.axis, self._service.configuration.model.machine
        datums = self._service.pipeline.datums
        if axis not in datums:
            raise InputError(
                "not an axis whose datum is set",
                field=axis,
                expected="one of " + (", ".join(datums) or "none"),
            )
        allowed = position_range(machine.axis(axis))
        if not allowed.low <= request.position <= allowed.high:
            raise InputError(
                "is not on the axis",
                field=axis,
                found=request.position,
                expected=f"{allowed.low:g} to {allowed.high:g}",
            )
        rotary = is_rotary(axis)
        datum = datums[axis]
        datum.set(math.radians(request.position) if rotary else request.position)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_WITHIN):
                await datum.settled()
        if datum.pending:
            datum.give_up("its position was not read while its datum was set")
        if datum.problem:
            raise InputError(datum.problem, field=axis)
        return f"datum: {axis} stands at {request.position:g} {'deg' if rotary else 'mm'}"

    def _state(self) -> dict[str, Any]:
        pipeline, now = self._service.pipeline, time.monotonic()
        running, in_file = self._service.configuration, self._service.switches_in_file
        machine = running.model.machine
        return {
            "switches": running.model.switches,
            "in_file": {
                name: there
                for name, (_, there) in changed_live(running.model.switches, in_file).items()
            },
            "until": until_words(running.model.switches, in_file, running.model_path),
            "entered": {
                name: {
                    "value": reading.value if math.isfinite(reading.value) else None,
                    "unit": machine.signals[name].unit,
                    "age_s": round(now - reading.time, 1) if math.isfinite(reading.time) else None,
                    "fault": reading.fault,
                }
                for name, reading in pipeline.entered.items()
            },
            "datums": {axis: datum.problem for axis, datum in pipeline.datums.items()},
        }
