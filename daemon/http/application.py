"""The HTTP interface's routes: health, metrics, the status and its parts, the stream, changes."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Annotated, Any

from fastapi import APIRouter, Depends, FastAPI, Query, Request, Security
from fastapi.encoders import jsonable_encoder
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse
from fastapi.security import HTTPBearer
from starlette.exceptions import HTTPException
from starlette.responses import Response

from abbe.daemon.config.tokens import Role
from abbe.daemon.control.requests import DatumRequest, EnterRequest, StateRequest, SwitchRequest
from abbe.daemon.http.answers import ChangeableState, HttpProblem
from abbe.daemon.http.cycles.cycle_event import StreamedCycle
from abbe.daemon.http.cycles.stream import CycleStream
from abbe.daemon.http.gate import Gate, Visitor
from abbe.daemon.http.interface import Interface
from abbe.daemon.http.pages import api_page, status_page
from abbe.daemon.status.run_status import AxisStatus, LinkHealth, RunStatus, SignalStatus

MOST_STREAMS = 64
"""Streams of cycles at a time."""
_SECURE = {
    "cache-control": "no-store",
    "content-security-policy": "default-src 'none'; style-src 'unsafe-inline'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
}
_SILENT: dict[int | str, dict[str, Any]] = {
    401: {"model": HttpProblem, "description": "no token, or one that does not count"},
    503: {"model": HttpProblem, "description": "the run says nothing"},
}
_REFUSED: dict[int | str, dict[str, Any]] = {
    **_SILENT,
    403: {"model": HttpProblem, "description": "a token that may only look"},
    409: {"model": HttpProblem, "description": "it cannot be; nothing has changed"},
}


def application(interface: Interface, version: str) -> FastAPI:
    """The ASGI application.

    Parameters
    ----------
    interface
        What the routes stand on.
    version
        Of Abbe.
    """
    app = FastAPI(
        title=f"Abbe: {interface.machine}" if interface.machine else "Abbe",
        version=version,
        description="What a running correction says of itself, and what may be changed while it "
        "runs. Positions in mm (rotary: degrees), corrections in µm (rotary: µrad).",
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
    )
    app.add_exception_handler(HTTPException, _problem)
    app.add_exception_handler(RequestValidationError, _invalid)
    view = [Depends(_needs(interface.gate, "view"))]
    app.include_router(_health(interface))
    app.include_router(_pages(interface, app), dependencies=view)
    app.include_router(_look(interface), prefix="/api/v1", dependencies=view)
    app.include_router(_change(interface), prefix="/api/v1")
    return app


def _needs(gate: Gate, role: Role) -> Callable[..., Awaitable[Visitor]]:
    """A dependency: who asks; 401 without a token, 403 with one that is not enough."""
    # for the description only: the gate reads the header by itself
    bearer = Security(
        HTTPBearer(auto_error=False, description="`abbe token add CONFIG NAME` makes one")
    )

    async def visitor(request: Request, _: Any = bearer) -> Visitor:
        found = gate.visitor(request.scope)
        if found.role is None:
            raise HTTPException(401, "a token is needed: Authorization: Bearer …")
        # what a browser sends on its own (HTTP's basic way) could be another page's doing
        if role == "operate" and not (found.role == "operate" and found.bearer):
            gate.refuse(found.who, "it may look, and change nothing")
            raise HTTPException(403, "this takes a token of the role operate, sent as Bearer")
        return found

    return visitor


def _health(interface: Interface) -> APIRouter:
    """Two lights, for everybody."""
    router = APIRouter(tags=["health"])
    said: dict[int | str, dict[str, Any]] = {503: {"description": "no", "content": _TEXT}}

    @router.get("/healthz", response_class=PlainTextResponse, responses=said)
    async def healthz() -> Response:
        """Whether Abbe runs and its cycle goes round."""
        alive = (await interface.status()).alive
        return PlainTextResponse("ok\n" if alive else "the cycle hangs\n", 200 if alive else 503)

    @router.get("/readyz", response_class=PlainTextResponse, responses=said)
    async def readyz() -> Response:
        """Whether every direction is corrected in full (or computed, where nothing is written)."""
        status = await interface.status()
        ready = status.in_full or (status.computed_in_full and not status.writes)
        ready = ready and not status.ending
        return PlainTextResponse("ok\n" if ready else f"{status.state}\n", 200 if ready else 503)

    return router


class _Events(Response):
    """How the description names the stream."""

    media_type = "text/event-stream"


_TEXT: dict[str, Any] = {"text/plain": {}}


def _pages(interface: Interface, app: FastAPI) -> APIRouter:
    router = APIRouter()

    @router.get("/metrics", tags=["health"], response_class=PlainTextResponse)
    async def metrics(request: Request) -> Response:
        """Metrics for Prometheus: OpenMetrics, or its older text where that is asked for."""
        content, kind = await interface.metrics(request.headers.get("accept", ""))
        return Response(content, headers={"content-type": kind})

    @router.get("/", include_in_schema=False)
    async def page() -> Response:
        return HTMLResponse(status_page(await interface.status()), headers=_SECURE)

    @router.get("/docs", include_in_schema=False)
    async def docs() -> Response:
        return HTMLResponse(api_page(app.openapi()), headers=_SECURE)

    @router.get("/api/openapi.json", include_in_schema=False)
    async def openapi() -> Response:
        return JSONResponse(app.openapi())

    return router


def _look(interface: Interface) -> APIRouter:
    router = APIRouter(tags=["look"], responses=_SILENT)

    @router.get("/status", response_model=RunStatus)
    async def status() -> Response:
        """All that the run says of itself."""
        return Response(await interface.raw_status(), media_type="application/json")

    @router.get("/axes")
    async def axes() -> dict[str, AxisStatus]:
        """Every axis: indicated, corrected, correction ± uncertainty, what the guard does."""
        return (await interface.status()).axes

    @router.get("/signals")
    async def signals() -> dict[str, SignalStatus]:
        """Every signal with its age."""
        return (await interface.status()).signals

    @router.get("/links")
    async def links() -> dict[str, LinkHealth]:
        """Every link."""
        return (await interface.status()).links

    @router.get("/faults")
    async def faults() -> dict[str, str]:
        """What is wrong → why."""
        return (await interface.status()).faults

    @router.get(
        "/cycles",
        response_class=_Events,
        responses={
            200: {
                "model": StreamedCycle,
                "description": "Server-sent events: `event: cycle` with a StreamedCycle; `event: "
                "dropped` with how many before it are missing, because they were not read in time",
            }
        },
    )
    async def cycles(
        every: Annotated[
            float, Query(ge=0.0, le=3600.0, description="s from one to the next; 0: every cycle")
        ] = 0.1,
    ) -> Response:
        """Cycles as they come."""
        if interface.hub.streams >= MOST_STREAMS:
            raise HTTPException(503, f"{MOST_STREAMS} clients stream already")
        return CycleStream(interface.hub, every)

    @router.get("/control")
    async def control() -> ChangeableState:
        """What is switched, typed in and set at present."""
        return await interface.change(StateRequest(), "somebody who looks")

    return router


def _change(interface: Interface) -> APIRouter:
    """What takes a token of the role operate, and a [control] in the configuration."""
    router = APIRouter(tags=["operate"], responses=_REFUSED)
    operator: Any = Depends(_needs(interface.gate, "operate"))

    @router.post("/switch")
    async def switch(change: SwitchRequest, visitor: Visitor = operator) -> ChangeableState:
        """One compensation on, off, or only shown; led over as a ramp."""
        return await interface.change(change, visitor.who)

    @router.post("/enter")
    async def enter(change: EnterRequest, visitor: Visitor = operator) -> ChangeableState:
        """A value that no sensor reads, as a person read it."""
        return await interface.change(change, visitor.who)

    @router.post("/datum")
    async def datum(change: DatumRequest, visitor: Visitor = operator) -> ChangeableState:
        """Where an axis stands whose encoder does not know."""
        return await interface.change(change, visitor.who)

    return router


async def _problem(_request: Request, error: Exception) -> Response:
    found = error if isinstance(error, HTTPException) else HTTPException(500)
    response = JSONResponse({"detail": found.detail}, found.status_code)
    if found.status_code == 401:
        # two ways, and a browser asks for the password of the first
        response.headers.append("www-authenticate", 'Basic realm="Abbe", charset="UTF-8"')
        response.headers.append("www-authenticate", 'Bearer realm="Abbe"')
    return response


async def _invalid(_request: Request, error: Exception) -> Response:
    """One sentence for what is no request; what was sent is not sent back."""
    if not isinstance(error, RequestValidationError) or not error.errors():
        return JSONResponse({"detail": "not a request"}, 422)
    first = jsonable_encoder(error.errors()[0])
    where = ".".join(str(part) for part in first["loc"])
    return JSONResponse({"detail": f"{where}: {first['msg']}"}, 422)
