"""The routes of the workbench: its answers as JSON, and what its views and files bring along."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import Annotated, Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import Field
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.sentences import as_it_stands, sentences_in
from abbe.daemon.workbench.calibration.routes import calibration_routes
from abbe.daemon.workbench.campaign_routes import campaign_routes
from abbe.daemon.workbench.entrance.asked import AskedByPerson, AskedOfWorkbench, Nothing, who_asks
from abbe.daemon.workbench.page_files import page_files
from abbe.daemon.workbench.residuals.brush import Brush
from abbe.daemon.workbench.session.workbench import Workbench
from abbe.daemon.workbench.tables.routes import table_routes
from abbe.daemon.workbench.views import WorkbenchViews

_LEVEL = 6
"""Of compression."""
_SMALL = 2000
"""Bytes of an answer from which on it is compressed."""
Spec = Annotated[str, Field(min_length=1, max_length=2000)]


class MadeVersion(AskedByPerson):
    """A version to be made of what the page stood `on`."""

    on: Annotated[str, Field(max_length=64)] = ""


class AddedCause(MadeVersion):
    """A cause to be added."""

    spec: Spec


class TriedCause(AskedOfWorkbench):
    """A cause to be tried; without `values` as it would be fitted."""

    spec: Spec
    values: dict[str, float] | None = Field(default=None, max_length=1000)


class OtherVersion(AskedByPerson):
    """A version to go back to, by its place in the list."""

    version: int


class NotedVersion(AskedByPerson):
    """What a person notes of a version."""

    version: int
    text: Annotated[str, Field(min_length=1, max_length=4000)]


def application(views: WorkbenchViews, end: Callable[[], None]) -> FastAPI:
    """The ASGI application, to be set behind a `WorkbenchDoor`.

    Parameters
    ----------
    views
        What is shown.
    end
        Ends the server.
    """
    app = FastAPI(title="Abbe's workbench", openapi_url=None, docs_url=None, redoc_url=None)
    app.add_exception_handler(AbbeError, _problem)
    app.add_exception_handler(RequestValidationError, _invalid)
    # streams are left alone by it
    app.add_middleware(GZipMiddleware, minimum_size=_SMALL, compresslevel=_LEVEL)
    app.include_router(page_files())
    if views.live is not None:
        app.include_router(views.live.routes())
    _frame(app, views, end)
    if views.bench is not None:
        _look(app, views.bench)
        _change(app, views.bench)
        app.include_router(campaign_routes(views.bench))
    if views.desk is not None:
        desk = views.desk
        app.include_router(table_routes(lambda: desk, "/api/tables"))
    if views.guide is not None:
        app.include_router(calibration_routes(views.guide))
    return app


def _frame(app: FastAPI, views: WorkbenchViews, end: Callable[[], None]) -> None:
    run = secrets.token_hex(8)

    @app.get("/api/state")
    def state() -> dict[str, Any]:
        """What is known, and what is under way; `run` tells a server from the one after it."""
        return {**views.state(), "run": run, "views": views.names, "first": views.first}

    @app.get("/api/head")
    def head() -> dict[str, Any]:
        """Machine, date, files with their SHA-256."""
        return views.head()

    @app.post("/api/here")
    def here(_: Nothing) -> dict[str, str]:
        """Somebody is there: the session goes on."""
        return {}

    @app.post("/api/end")
    def ended(_: Nothing) -> dict[str, str]:
        """End the workbench."""
        if views.writing:
            raise InputError("something is under way at the controller", expected="its end")
        end()
        return {}


def _look(app: FastAPI, bench: Workbench) -> None:
    @app.get("/api/compare")
    def compared() -> Response:
        """Whether the model holds, and where not."""
        return _known(bench.findings.compared)

    @app.post("/api/brush")
    def brushed(brush: Brush) -> dict[str, Any]:
        """Which of many rows are chosen; changes nothing."""
        return bench.findings.brushed(brush)

    @app.get("/api/learn")
    def learned() -> Response:
        """Which causes are missing."""
        return _known(bench.findings.learned)

    @app.get("/api/watch")
    def watched() -> dict[str, Any]:
        """The versions and their errors."""
        return bench.watched()

    @app.get("/api/beside")
    def besides(left: int, right: int) -> Response:
        """Two versions side by side."""
        return _known(bench.beside(left, right))

    @app.post("/api/try")
    def tried(cause: TriedCause) -> dict[str, Any] | None:
        """What a cause would leave, null while causes are not known; changes nothing."""
        return bench.findings.tried(cause.spec, cause.values)


def _change(app: FastAPI, bench: Workbench) -> None:
    @app.post("/api/compare")
    def compare(_: Nothing) -> dict[str, Any]:
        """Lay the present version beside the campaigns."""
        bench.look()
        return bench.state()

    @app.post("/api/learn")
    def learn(_: Nothing) -> dict[str, Any]:
        """Find causes."""
        bench.learn()
        return bench.state()

    @app.post("/api/fit")
    def fit(wanted: MadeVersion, request: Request) -> dict[str, Any]:
        """Fit the present version as it is."""
        bench.fit(who_asks(wanted.by, request), wanted.on)
        return bench.state()

    @app.post("/api/add")
    def add(cause: AddedCause, request: Request) -> dict[str, Any]:
        """Add a cause and refit."""
        bench.add(cause.spec, who_asks(cause.by, request), cause.on)
        return bench.state()

    @app.post("/api/read-again")
    def read_again(wanted: AskedByPerson, request: Request) -> dict[str, Any]:
        """Read model and campaigns as they lie on the disk now."""
        bench.campaigns.read_again(who_asks(wanted.by, request))
        return bench.state()

    @app.post("/api/back")
    def back(other: OtherVersion, request: Request) -> dict[str, Any]:
        """Look at another version."""
        bench.go_back(other.version, who_asks(other.by, request))
        return bench.state()

    @app.post("/api/note")
    def note(noted: NotedVersion, request: Request) -> dict[str, Any]:
        """Keep what a person notes of a version."""
        bench.note(noted.text, noted.version, who_asks(noted.by, request))
        return bench.state()


def _known(answer: bytes | None) -> Response:
    if answer is None:
        return JSONResponse(None)
    return Response(answer, media_type="application/json")


async def _problem(_request: Request, error: Exception) -> Response:
    said = error.sentence if isinstance(error, AbbeError) else as_it_stands(str(error))
    return JSONResponse({"detail": said, "sentences": sentences_in(said)}, 409)


async def _invalid(_request: Request, error: Exception) -> Response:
    """One sentence for what is no request; what was sent is not sent back."""
    found = error.errors() if isinstance(error, RequestValidationError) else []
    if not found:
        return JSONResponse({"detail": "not a request"}, 422)
    where = ".".join(str(part) for part in found[0]["loc"])
    return JSONResponse({"detail": f"{where}: {found[0]['msg']}"}, 422)
