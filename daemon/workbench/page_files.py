"""The files of the page, each by a route of its own: no path is made of what somebody sends."""

from __future__ import annotations

import functools
import gzip
import hashlib
import json
from collections.abc import Callable, Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable

from fastapi import APIRouter, Request
from starlette.responses import Response

from abbe.daemon.report.pictures.packed import plotly_script

_KINDS = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "json": "application/json",
    "svg": "image/svg+xml",
    "txt": "text/plain; charset=utf-8",
}
_WORDS = "words/"
"""Room of the languages, a file each."""
_LEVEL = 6
"""Of compression."""


def page_files() -> APIRouter:
    """Routes of every file in ``static`` and its rooms, of Plotly's script, and the languages."""
    router = APIRouter(include_in_schema=False)
    languages = {"en": "English"}
    for name, file in _below(files("abbe.daemon.workbench").joinpath("static"), ""):
        content = file.read_bytes()
        if name.startswith(_WORDS):
            languages[file.name.removesuffix(".json")] = json.loads(content)["_language"]
        path = "/" if name == "index.html" else f"/{name}"
        router.add_api_route(path, _served(content, _KINDS[name.rpartition(".")[2]]))

    @router.get("/api/languages")
    def known_languages() -> dict[str, str]:
        """Code of each language → its own name; each but English is a file of words."""
        return languages

    router.add_api_route("/plotly.min.js", _served(plotly_script(), _KINDS["js"]))
    return router


def _below(folder: Traversable, name: str) -> Iterator[tuple[str, Traversable]]:
    """Every file of a folder and its rooms, with its path from there."""
    for part in sorted(folder.iterdir(), key=lambda found: found.name):
        if part.is_dir():
            yield from _below(part, f"{name}{part.name}/")
        else:
            yield f"{name}{part.name}", part


def _served(content: bytes, kind: str) -> Callable[[Request], Response]:
    """A file, compressed where the browser takes that, and not sent again where it has it.

    The browser asks each time whether it has the newest (``no-cache``): files of two versions of
    Abbe never meet in one page.
    """
    tag = hashlib.sha256(content).hexdigest()[:32]
    headers = {"cache-control": "no-cache", "content-type": kind, "vary": "accept-encoding"}
    # made once, when somebody asks: it takes a third of a second for the largest
    packed = functools.cache(functools.partial(gzip.compress, content, _LEVEL, mtime=0))

    def served(request: Request) -> Response:
        small = "gzip" in request.headers.get("accept-encoding", "")
        own = headers | {"etag": f'"{tag}{"-gzip" if small else ""}"'}
        if request.headers.get("if-none-match") == own["etag"]:
            return Response(status_code=304, headers=own)
        if small:
            return Response(packed(), headers=own | {"content-encoding": "gzip"})
        return Response(content, headers=own)

    return served
