"""The routes of the live view: the stream of a run, its volume, its past."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query
from starlette.responses import Response

from abbe.compcore.errors import AbbeError, InputError
from abbe.daemon.answers.inputs import now
from abbe.daemon.config.identity import abbe_version
from abbe.daemon.workbench.live import history
from abbe.daemon.workbench.live.follower import LiveFollower
from abbe.daemon.workbench.live.present import PresentRun
from abbe.daemon.workbench.live.stream import LiveEvents
from abbe.daemon.workbench.live.volume import present_volume

Moment = Annotated[float, Query(ge=0.0, le=1e11, allow_inf_nan=False, description="s since 1970")]
Picture = Annotated[str, Query(min_length=1, max_length=100)]


class LiveView:
    """What the live page stands on.

    Parameters
    ----------
    config
        The configuration of the run; None: whichever runs on this computer.
    first
        Whether the live page is the one that is shown first.
    """

    def __init__(self, config: Path | None, *, first: bool) -> None:
        self._present = PresentRun(config)
        self._follower = LiveFollower(self._present)
        # pictures of a month read much of a disk that the run writes to
        self._reading = threading.Lock()
        self.first = "live" if first else "compare"

    def state(self) -> dict[str, Any]:
        """What the page asks of a session, where there is none."""
        return {"changes": 0, "task": None, "error": "", "version": "", "first": "only live"}

    def head(self) -> dict[str, Any]:
        """Machine, date, files of the run."""
        machine, files = "Abbe", []
        try:
            status = self._present.status()
        except AbbeError:
            pass
        else:
            machine = status.machine or "Machine"
            files = [[f.role, Path(f.path).name, f.sha256] for f in status.files]
        made = now()
        return {
            "machine": machine,
            "facts": [["Date", made]],
            "files": files,
            "abbe": abbe_version(),
            "made": made,
        }

    def routes(self) -> APIRouter:
        """The routes."""
        router = APIRouter(prefix="/api/live")
        present = self._present

        @router.get("/stream")
        async def stream() -> Response:
            """The run as it stands, from now on."""
            return LiveEvents(self._follower)

        @router.get("/volume")
        def volume() -> dict[str, Any]:
            """Its errors all over the volume at present."""
            return present_volume(present.status(), present.model)

        @router.get("/history")
        def overview() -> dict[str, Any]:
            """From when to when there are records, and of what."""
            return history.overview(self._records(), present.model_or_none)

        @router.get("/picture")
        def picture(name: Picture, first: Moment, last: Moment) -> dict[str, Any]:
            """One picture of the past, thinned."""
            path = self._records()
            with self._reading:
                return history.one_picture(path, present.model_or_none, name, first, last)

        return router

    def _records(self) -> Path:
        path = self._present.records
        if path is None:
            raise InputError(
                "no records are kept of this run",
                field="records",
                expected="a line [records] in its configuration",
            )
        return path
