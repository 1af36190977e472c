"""The files of the page, each by a route of its own: no path is made of what somebody sends."""

from __future__ import annotations

import functools
import gzip
import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
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
_LATER = ("plotly.min.js", "report/report.js", "uplot/uplot.min.js")
"""Scripts that the workbench's page asks for when they are needed, or never."""
_KEPT = "private, max-age=31536000, immutable"
"""Of a file whose address changes with it."""
_LEVEL = 6
"""Of compression."""


def page_files() -> APIRouter:
    """Routes of every file in ``static`` and its rooms, of Plotly's script, and the languages.

    Pages stand at their names. All that they bring along stands below a word that is made of all of
    it, so that a browser keeps it and asks for nothing twice; another Abbe has another word.
    """
    found = dict(_below(files("abbe.daemon.workbench").joinpath("static"), ""))
    contents = {name: file.read_bytes() for name, file in found.items()}
    languages = {"en": "English"} | {
        name.removeprefix(_WORDS).removesuffix(".json"): json.loads(content)["_language"]
        for name, content in contents.items()
        if name.startswith(_WORDS)
    }
    contents[f"{_WORDS}languages.json"] = json.dumps(languages, ensure_ascii=False).encode()
    contents["plotly.min.js"] = plotly_script()
    pages = {name: content for name, content in contents.items() if name.endswith(".html")}
    digest = hashlib.sha256()
    for name, content in contents.items():
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    word = f"/files-{digest.hexdigest()[:16]}"
    router = APIRouter(include_in_schema=False)
    for name, content in contents.items():
        kind = _KINDS[name.rpartition(".")[2]]
        if name in pages:
            path = "/" if name == "index.html" else f"/{name}"
            parts = [p for p in contents if p.endswith(".js") and p not in _LATER]
            whole = _page(content, word, parts if name == "index.html" else ())
            router.add_api_route(path, _served(whole, kind, "no-cache"))
        else:
            router.add_api_route(f"{word}/{name}", _served(content, kind, _KEPT))
    return router


def _page(content: bytes, word: str, parts: Sequence[str]) -> bytes:
    """A page whose files lie below a word, and which asks for parts of its script all at once."""
    asked = "\n".join(f'<link rel="modulepreload" href="{word}/{part}">' for part in parts)
    return content.replace(b"{files}", word.encode()).replace(b"{parts}", asked.encode())


def _below(folder: Traversable, name: str) -> Iterator[tuple[str, Traversable]]:
    """Every file of a folder and its rooms, with its path from there."""
    for part in sorted(folder.iterdir(), key=lambda found: found.name):
        if part.is_dir():
            yield from _below(part, f"{name}{part.name}/")
        else:
            yield f"{name}{part.name}", part


def _served(content: bytes, kind: str, keep: str) -> Callable[[Request], Response]:
    """A file, compressed where the browser takes that, and not sent again where it has it.

    `keep` says how long the browser may take it for the newest without asking.
    """
    tag = hashlib.sha256(content).hexdigest()[:32]
    headers = {"cache-control": keep, "content-type": kind, "vary": "accept-encoding"}
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
