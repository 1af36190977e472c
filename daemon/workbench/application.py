"""The routes of the workbench: its files, and its answers as JSON."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from importlib.resources import files
from typing import Annotated, Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from abbe.compcore.errors import AbbeError
from abbe.daemon.report.page import plotly_script
from abbe.daemon.workbench.session import Workbench

_KINDS = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
Spec = Annotated[str, Field(min_length=1, max_length=2000)]


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class AddedCause(_Asked):
    """A cause to be added."""

    spec: Spec


class TriedCause(_Asked):
    """A cause to be tried; without `values` as it would be fitted."""

    spec: Spec
    values: dict[str, float] | None = Field(default=None, max_length=1000)


class OtherVersion(_Asked):
    """A version to go back to, by its place in the list."""

    version: int


class Nothing(_Asked):
    """A request that says no more than its path."""


def application(bench: Workbench, end: Callable[[], None]) -> FastAPI:
    """The ASGI application, to be set behind a `WorkbenchDoor`.

    Parameters
    ----------
    bench
        The session.
    end
        Ends the server.
    """
    app = FastAPI(title="Abbe's workbench", openapi_url=None, docs_url=None, redoc_url=None)
    app.add_exception_handler(AbbeError, _problem)
    app.add_exception_handler(RequestValidationError, _invalid)
    _files(app)
    _look(app, bench)
    _change(app, bench, end)
    return app


def _files(app: FastAPI) -> None:
    """Every file by its own route: no path is ever made of what somebody sends."""
    for file in sorted(files("abbe.daemon.workbench").joinpath("static").iterdir(), key=str):
        name = file.name
        kind = _KINDS[name.rpartition(".")[2]]
        path = "/" if name == "index.html" else f"/{name}"
        app.add_api_route(path, _served(file.read_bytes(), kind), include_in_schema=False)
    script = plotly_script()
    app.add_api_route("/plotly.min.js", _served(script, _KINDS["js"]), include_in_schema=False)


def _served(content: bytes, kind: str) -> Callable[[Request], Response]:
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    headers = {"etag": tag, "cache-control": "no-cache", "content-type": kind}

    def served(request: Request) -> Response:
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        return Response(content, headers=headers)

    return served


def _look(app: FastAPI, bench: Workbench) -> None:
    @app.get("/api/state")
    def state() -> dict[str, Any]:
        """What is known, and what is under way."""
        return bench.state()

    @app.get("/api/head")
    def head() -> dict[str, Any]:
        """Machine, date, files with their SHA-256."""
        return bench.head()

    @app.get("/api/compare")
    def compared() -> Response:
        """Whether the model holds, and where not."""
        return _known(bench.compared())

    @app.get("/api/learn")
    def learned() -> Response:
        """Which causes are missing."""
        return _known(bench.learned())

    @app.get("/api/watch")
    def watched() -> dict[str, Any]:
        """The versions and their errors."""
        return bench.watched()

    @app.post("/api/try")
    def tried(cause: TriedCause) -> dict[str, Any]:
        """What a cause would leave; changes nothing."""
        return bench.tried(cause.spec, cause.values)


def _change(app: FastAPI, bench: Workbench, end: Callable[[], None]) -> None:
    @app.post("/api/learn")
    def learn(_: Nothing) -> dict[str, Any]:
        """Find causes."""
        bench.learn()
        return bench.state()

    @app.post("/api/fit")
    def fit(_: Nothing) -> dict[str, Any]:
        """Fit the present version as it is."""
        bench.fit()
        return bench.state()

    @app.post("/api/add")
    def add(cause: AddedCause) -> dict[str, Any]:
        """Add a cause and refit."""
        bench.add(cause.spec)
        return bench.state()

    @app.post("/api/back")
    def back(other: OtherVersion) -> dict[str, Any]:
        """Look at another version."""
        bench.go_back(other.version)
        return bench.state()

    @app.post("/api/end")
    def ended(_: Nothing) -> dict[str, str]:
        """End the workbench."""
        end()
        return {}


def _known(answer: bytes | None) -> Response:
    if answer is None:
        return JSONResponse(None)
    return Response(answer, media_type="application/json")


async def _problem(_request: Request, error: Exception) -> Response:
    return JSONResponse({"detail": str(error)}, 409)


async def _invalid(_request: Request, error: Exception) -> Response:
    """One sentence for what is no request; what was sent is not sent back."""
    found = error.errors() if isinstance(error, RequestValidationError) else []
    if not found:
        return JSONResponse({"detail": "not a request"}, 422)
    where = ".".join(str(part) for part in found[0]["loc"])
    return JSONResponse({"detail": f"{where}: {found[0]['msg']}"}, 422)
