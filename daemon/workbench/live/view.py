"""The routes of the live view: the stream of a run, its volume, its past."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query
from starlette.responses import Response

from abbe.compcore.campaign.measuring_conditions import STATED
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.model.model import Model
from abbe.daemon.answers.inputs import now
from abbe.daemon.config import load_config
from abbe.daemon.installed import abbe_version
from abbe.daemon.report.head import AIR, facts_of
from abbe.daemon.status.run_status import RunStatus
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
        return {"changes": 0, "task": None, "error": "", "version": ""}

    def end(self) -> None:
        """End the streams of all browsers."""
        self._follower.end()

    def head(self) -> dict[str, Any]:
        """Machine, date, files of the run."""
        machine, files, air = "Abbe", [], []
        model = self._model()
        try:
            status = self._present.status()
        except AbbeError:
            if model is not None:
                machine = model.machine.name or "Machine"
        else:
            machine = status.machine or "Machine"
            files = [[f.role, Path(f.path).name, f.sha256] for f in status.files]
            air = list(_air(status, model))
        made = now()
        facts = facts_of([], None if model is None else model.machine)
        facts |= {STATED["machine"]: machine, STATED["date"]: made}
        facts[STATED["environment"]] = "; ".join(air)
        del facts[STATED["instrument"]]
        return {
            "machine": machine,
            "facts": [list(fact) for fact in facts.items()],
            "files": files,
            "abbe": abbe_version(),
            "made": made,
        }

    def _model(self) -> Model | None:
        """The model of the run, or of the configuration where none is seen."""
        if self._present.model_or_none is not None or self._present.config is None:
            return self._present.model_or_none
        try:
            return load_config(self._present.config).model
        except AbbeError:
            return None

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


def _air(status: RunStatus, model: Model | None) -> Iterator[str]:
    """What thermometers in the air show at present."""
    for name, signal in status.signals.items():
        known = None if model is None else model.machine.signals.get(name)
        if known is not None and known.role in AIR and signal.value is not None:
            unit = "°C" if signal.unit == "degC" else signal.unit
            yield f"{name} {signal.value:.2f} {unit}"
