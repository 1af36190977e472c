"""Uploading as the run sees it: its status handed over now and then, and never waited for."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import time
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from abbe.daemon.config.configuration import Configuration
from abbe.daemon.config.sections.fleet import FleetSetup
from abbe.daemon.control.controls import Controls
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.side_process.parent import SideProcess
from abbe.daemon.status.status_source import ObservedService

logger = logging.getLogger("abbe.fleet")

_EVERY = 10.0
"""s between two statuses at most."""
_WITHOUT_A_CYCLE = 0.5
"""s after which a status is made although no cycle comes to its end."""
_WAITING = 1_000_000
"""Bytes that may wait for the process; what is more is dropped."""
_LONGEST = 10_000
"""Bytes of a line of the process's."""
_A_MINUTE = 20
"""Sentences of the process's that go into the journal."""


class StoreProcess:
    """Keeps the process that uploads running while `run` runs.

    Parameters
    ----------
    service
        What runs.
    controls
        Make the status.
    setup
        The plant's store.
    """

    def __init__(self, service: ObservedService, controls: Controls, setup: FleetSetup) -> None:
        self._service, self._controls, self._setup = service, controls, setup

    async def run(self) -> None:
        """Until cancelled; whatever happens to process and store, the correction goes on."""
        await SideProcess(
            "fleet", "abbe.daemon.fleet.uploading.process", self._talk, _LONGEST
        ).run()

    def _talk(self) -> _UploadTalk:
        task = upload_task(self._service.configuration, self._setup)
        return _UploadTalk(self._service, self._controls, task)


def upload_task(configuration: Configuration, setup: FleetSetup) -> dict[str, Any]:
    """What the process that uploads has to know, as JSON takes it."""
    return {
        **setup.task(),
        "folder": str(configuration.path.parent.absolute()),
        "model": configuration.file.model,
        "structure": str(configuration.model.machine.structure),
        "records": str(configuration.records_path),
        "checks": str(configuration.checks_path.absolute()),
    }


class _UploadWord(BaseModel):
    """One line of the process's."""

    model_config = ConfigDict(extra="forbid")
    level: Annotated[int, Field(ge=0, le=50)] = 0
    text: str = ""


class _UploadTalk:
    """One connection to the process."""

    def __init__(self, service: ObservedService, controls: Controls, task: dict[str, Any]) -> None:
        self._service, self._controls, self._task = service, controls, task
        self._between = asyncio.Event()
        self._said, self._said_since = 0, 0.0
        self._failed = False
        self.last_message_at: float | None = None

    async def run(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Hand statuses over until the process is gone."""
        listeners = self._service.pipeline.listeners
        writer.write(json.dumps(self._task).encode("ascii") + b"\n")
        listeners.append(self._on_cycle)
        handing = asyncio.create_task(self._hand_over(writer))
        try:
            while line := await reader.readline():
                self._take(line)
        except (OSError, ValueError):
            pass  # gone, or a stranger
        finally:
            listeners.remove(self._on_cycle)
            handing.cancel()
            writer.close()

    def _on_cycle(self, record: CycleRecord) -> None:
        self._between.set()

    def _take(self, line: bytes) -> None:
        try:
            said = _UploadWord.model_validate_json(line)
        except ValidationError:
            raise ValueError("not a line of the process that uploads") from None
        now = self.last_message_at = time.monotonic()
        if not said.text:
            return
        if now - self._said_since > 60.0:
            self._said, self._said_since = 0, now
        self._said += 1
        if self._said <= _A_MINUTE:
            text = "".join(c if c.isprintable() else " " for c in said.text)
            logger.log(said.level or logging.INFO, "fleet: %s", text)

    async def _hand_over(self, writer: asyncio.StreamWriter) -> None:
        while True:
            # between two cycles, so that none waits for it
            self._between.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_WITHOUT_A_CYCLE):
                    await self._between.wait()
            try:
                status = self._controls.status_now().model_dump_json().encode()
            except Exception as error:
                if not self._failed:
                    logger.exception("fleet: a status cannot be uploaded: %s", error)
                self._failed = True
            else:
                if writer.transport.get_write_buffer_size() < _WAITING:
                    writer.write(status + b"\n")
            await asyncio.sleep(min(_EVERY, self._task["every"]))
