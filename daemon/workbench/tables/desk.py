"""The upload from the workbench: looked at first, then done by whoever may, one at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.sentences import sentences_in
from abbe.daemon.answers.tables.upload_words import result_lines
from abbe.daemon.config import Configuration
from abbe.daemon.upload.operator_port import OperatorPort
from abbe.daemon.upload.session import (
    Result,
    UploadRequest,
    finish,
    opened,
    roll_back,
    setup_of,
    upload,
    working,
)
from abbe.daemon.upload.status import status, status_lines
from abbe.daemon.workbench.fresh import FreshConfiguration
from abbe.daemon.workbench.tables.controller_work import Act, ControllerWork, DeskWork
from abbe.daemon.workbench.tables.held import held
from abbe.daemon.workbench.tables.past import past_uploads

Change = Literal["upload", "rollback"]


class TableDesk:
    """One machine's tables and its controller; may be asked from any thread.

    Parameters
    ----------
    config
        The configuration; read anew for whatever is done.
    folder
        What ``abbe table`` wrote; None: nothing is to be uploaded.
    uploaded
        Called with who had them uploaded once the tables of `folder` are active, in a thread.

    Raises
    ------
    InputError
        For a configuration that is not in order, and tables that are not.
    """

    def __init__(
        self,
        config: Path,
        folder: Path | None,
        uploaded: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.config, self.folder = config, folder
        self._uploaded = uploaded
        self._lock = threading.Lock()
        self._cleared: list[str] = []
        self._change: Change | None = None
        self._count = 0
        self._fresh = FreshConfiguration(config)
        self._at_controller = ControllerWork(self._fresh)
        configuration = self._fresh.now()
        if folder is not None:
            held(configuration, folder)

    def shown(self) -> dict[str, Any]:
        """The page: the tables, where they would go, what was uploaded before."""
        configuration = self._fresh.now()
        setup = configuration.upload
        where = None
        if setup is not None:
            section = setup.section
            where = {
                "to": " ".join(filter(None, [section.identity, section.serial])),
                "type": self._name(configuration),
                "journal": str(setup.journal),
            }
        http = configuration.http
        return {
            "tables": None if self.folder is None else held(configuration, self.folder),
            "upload": where,
            "roles": http is not None and http.tokens.exists(),
            "token": f"abbe token add {self.config} NAME --role operate",
            "past": past_uploads(configuration),
        }

    def state(self) -> dict[str, Any]:
        """What is under way, and the pre-flight that counts."""
        work = self._at_controller.last
        with self._lock:
            return {
                "work": None if work is None else vars(work) | {"said": list(work.said)},
                "cleared": self._count if self._cleared else None,
                "change": self._change,
                "sentences": {} if work is None else sentences_in(work.said),
            }

    def ask(self) -> None:
        """Ask the controller what is active, in a thread; writes nothing."""

        async def asked(configuration: Configuration, port: OperatorPort) -> tuple[bool, list[str]]:
            with working(configuration, port, "", writes=False) as work:
                async with opened(work):
                    return True, status_lines(await status(work))

        self._start(DeskWork("status"), asked)

    def preflight(self, change: Change) -> None:
        """What would change, and whether anything speaks against it, in a thread; writes nothing.

        Raises
        ------
        InputError
            Where there is nothing to upload, or something is under way.
        """
        if change == "upload" and self.folder is None:
            raise InputError("no tables were stated", expected="abbe open … --tables FOLDER")
        with self._lock:
            self._forget()

        async def looked(
            configuration: Configuration, port: OperatorPort
        ) -> tuple[bool, list[str]]:
            request = UploadRequest(dry_run=True)
            result = await self._changed(change, configuration, request, port)
            lines = result_lines(result, request)
            able = result.cleared is not None and not result.cleared.nothing_to_do
            if change == "upload" and result.cleared is not None and not able:
                lines += self._tell_uploaded("")  # they are active already
            with self._lock:
                if able and result.cleared is not None:
                    self._cleared, self._change = result.cleared.lines(), change
                    self._count += 1
            return able, lines

        self._start(DeskWork("preflight", change), looked)

    def write(self, count: int, machine: str, who: str, note: str) -> None:
        """Do what the pre-flight was about, in a thread.

        Parameters
        ----------
        count
            The pre-flight that was looked at.
        machine
            The machine's name, as it was typed.
        who, note
            For the journal.

        Raises
        ------
        InputError
            For another name, where that pre-flight does not count any more, or something is under
            way.
        """
        self._require_name(machine)
        with self._lock:
            change, seen = self._change, list(self._cleared)
            if change is None or count != self._count:
                raise InputError("the pre-flight does not count any more", expected="another one")

        async def written(
            configuration: Configuration, port: OperatorPort
        ) -> tuple[bool, list[str]]:
            request = UploadRequest(by=who, note=note)
            agreed = _same_as(seen, port)
            result = await self._changed(change, configuration, request, agreed)
            if result.declined:
                return False, [
                    "the controller or the tables are not what they were at the pre-flight: look "
                    "again; nothing was written"
                ]
            done = change == "upload" and result.ok
            told = self._tell_uploaded(who) if done else []
            return result.ok, [*result_lines(result, request), *told]

        self._start(DeskWork("write", change), written)

    def recover(self, machine: str, who: str) -> None:
        """Bring an upload that was cut off to its end, in a thread; raises as `write`."""
        self._require_name(machine)

        async def recovered(
            configuration: Configuration, port: OperatorPort
        ) -> tuple[bool, list[str]]:
            outcome = await finish(configuration, UploadRequest(by=who), port)
            if outcome is None:
                return True, ["no upload was cut off: nothing to recover"]
            return not outcome.open, outcome.lines()

        self._start(DeskWork("recover"), recovered)

    @property
    def busy(self) -> bool:
        """Whether something is under way at the controller."""
        return self._at_controller.busy

    def close(self) -> None:
        """Wait until what is under way has ended: an upload is not cut off."""
        self._at_controller.close()

    async def _changed(
        self,
        change: Change,
        configuration: Configuration,
        request: UploadRequest,
        port: OperatorPort,
    ) -> Result:
        if change == "rollback":
            return await roll_back(configuration, request, port)
        if self.folder is None:
            raise InputError("no tables were stated")
        return await upload(configuration, self.folder, request, port)

    def _require_name(self, machine: str) -> None:
        wanted = self._name(self._fresh.now())
        if " ".join(machine.split()) != " ".join(wanted.split()):
            raise InputError(
                "another machine: nothing was written", found=machine, expected=repr(wanted)
            )

    @staticmethod
    def _name(configuration: Configuration) -> str:
        """What has to be typed: the machine's name, or what its controller calls itself."""
        return configuration.model.machine.name or setup_of(configuration).section.identity

    def _tell_uploaded(self, who: str) -> list[str]:
        """Tell whoever wants to know; what cannot be noted takes nothing from what was done."""
        try:
            self._uploaded(who)
        except AbbeError as error:
            return [error.sentence]
        return []

    def _forget(self) -> None:
        self._cleared, self._change = [], None

    def _start(self, work: DeskWork, act: Act) -> None:
        self._at_controller.start(work, act)
        if work.kind != "preflight":
            with self._lock:
                # what was seen before counts for one attempt
                self._forget()


def _same_as(seen: list[str], port: OperatorPort) -> OperatorPort:
    """A port that agrees where the pre-flight found what was looked at."""
    return OperatorPort(port.tell, port.progress, lambda lines: lines == seen, port.restarted)
