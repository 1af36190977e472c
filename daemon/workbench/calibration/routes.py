"""The routes of a calibration: steps that compute for whoever has entered, measuring for a role."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from pydantic import Field
from starlette.responses import Response

from abbe.daemon.workbench.calibration.asked import AskedCalibration
from abbe.daemon.workbench.calibration.guide import MEASURES, CalibrationGuide
from abbe.daemon.workbench.entrance.asked import AskedOfWorkbench, Nothing
from abbe.daemon.workbench.entrance.role import operating
from abbe.daemon.workbench.tables.routes import table_routes

_APART = (
    "sandbox allow-scripts allow-modals allow-downloads allow-popups; default-src 'none'; "
    "script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:; "
    "font-src data:; worker-src blob:"
)
"""Of a page that a command wrote: its scripts run, as nobody's, without access to anything here."""
Word = Annotated[str, Field(max_length=200)]


class AskedFor(AskedOfWorkbench):
    """What a calibration is asked for."""

    time: Word
    check_time: Word
    tools: Word = ""
    controller: Word = ""
    tables: Word = ""


class StartedStep(AskedOfWorkbench):
    """A step that is to be done."""

    step: Word
    by: Word = ""
    language: Word = "en"


class AnsweredStep(AskedOfWorkbench):
    """An answer to what a step asks."""

    answer: Literal["yes", "no", "stands", "leave out"]


def calibration_routes(guide: CalibrationGuide) -> APIRouter:
    """The routes of a guide."""
    router = APIRouter(prefix="/api/calibrate")

    @router.get("")
    def shown() -> dict[str, Any]:
        """Every step as it stands, and the one that is under way."""
        return guide.shown()

    @router.get("/picture")
    def picture(
        plan: Literal["plan", "check"], number: Annotated[int, Query(ge=0, le=10_000)]
    ) -> Response:
        """A set-up, drawn."""
        return Response(guide.picture(plan, number), media_type="image/svg+xml")

    @router.get("/certificate")
    def certificate() -> Response:
        """The certificate, as `abbe verify` wrote it."""
        return Response(
            guide.certificate(),
            media_type="text/html",
            headers={"content-security-policy": _APART},
        )

    @router.post("/ask")
    def ask(asked: AskedFor) -> dict[str, Any]:
        """Ask for another time, tool, controller."""
        guide.ask_for(
            AskedCalibration(
                asked.time, asked.check_time, tuple(asked.tools.split()), asked.controller,
                asked.tables,
            )
        )  # fmt: skip
        return guide.shown()

    @router.post("/start")
    def start(wanted: StartedStep, request: Request) -> dict[str, Any]:
        """Do the next step; measuring takes the role ``operate``."""
        by = " ".join(wanted.by.split())
        if wanted.step in MEASURES:
            by = operating(guide.config, request, by)
        guide.start(wanted.step, by, wanted.language)
        return guide.shown()

    @router.post("/answer")
    def answer(said: AnsweredStep) -> dict[str, Any]:
        """Answer what the step asks."""
        guide.answer(said.answer)
        return guide.shown()

    @router.post("/stop")
    def stop(_: Nothing) -> dict[str, Any]:
        """Stop the step; it goes on later."""
        guide.stop()
        return guide.shown()

    router.include_router(table_routes(guide.desk, "/upload"))
    return router
