"""A service in this process with its HTTP process beside it, and clients of it."""

from __future__ import annotations

import asyncio
import socket
import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import httpx

from abbe.daemon.config.tokens import Role, add_token
from tests.daemon.pipeline.test_live_control import Run, running

PATIENCE = 60.0


class Observed:
    """A run with its HTTP interface."""

    def __init__(self, run: Run, folder: Path) -> None:
        self.run, self.folder = run, folder
        self.socket = folder / "http.sock"

    @asynccontextmanager
    async def client(self) -> AsyncIterator[httpx.AsyncClient]:
        """Over the Unix socket."""
        way = httpx.AsyncHTTPTransport(uds=str(self.socket))
        async with httpx.AsyncClient(
            transport=way, base_url="http://abbe", timeout=PATIENCE
        ) as client:
            yield client

    async def serving(self) -> None:
        """Until it answers."""
        async with asyncio.timeout(PATIENCE), self.client() as client:
            while True:
                try:
                    await client.get("/healthz")
                except (httpx.TransportError, OSError):
                    await asyncio.sleep(0.05)
                else:
                    return


@asynccontextmanager
async def observed(
    folder: Path, changes: dict[str, str] | None = None, http: str = ""
) -> AsyncIterator[Observed]:
    """A run on channels in memory, with ``[http]``, that already answers."""
    async with running(folder, changes, f"\n[http]\n{http}") as run:
        found = Observed(run, folder)
        await found.serving()
        yield found


async def until(what: Callable[[], Awaitable[bool] | bool]) -> None:
    """Until something holds."""
    async with asyncio.timeout(PATIENCE):
        while True:
            found = what()
            if found if isinstance(found, bool) else await found:
                return
            await asyncio.sleep(0.02)


def token(folder: Path, name: str, role: Role = "view", days: float | None = None) -> str:
    """A token for a run in a folder, made before or while it runs."""
    return add_token(folder / "http-tokens.toml", name, role, days)


def bearer(secret: str) -> dict[str, str]:
    """The header of a program."""
    return {"authorization": f"Bearer {secret}"}


def certificate(folder: Path, name: str = "http") -> tuple[Path, Path]:
    """A certificate for 127.0.0.1 that vouches for itself, made by openssl; and its key."""
    chain, key = folder / f"{name}.crt", folder / f"{name}.key"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
         "-nodes", "-days", "2", "-subj", "/CN=abbe", "-addext", "subjectAltName=IP:127.0.0.1",
         "-keyout", str(key), "-out", str(chain)],
        check=True, capture_output=True, timeout=PATIENCE,
    )  # fmt: skip
    return chain, key


async def events(response: httpx.Response) -> AsyncIterator[tuple[str, str, str]]:
    """Server-sent events as the HTML standard reads them: kind, id, data."""
    fields: dict[str, str] = {}
    async for line in response.aiter_lines():
        if not line:
            if "data" in fields:
                yield fields.get("event", "message"), fields.get("id", ""), fields["data"]
            fields = {}
        elif not line.startswith(":"):
            name, _, value = line.partition(": ")
            fields[name] = value


def free_port() -> int:
    """A port of 127.0.0.1 where nobody listens."""
    with socket.socket() as made:
        made.bind(("127.0.0.1", 0))
        port: int = made.getsockname()[1]
        return port
