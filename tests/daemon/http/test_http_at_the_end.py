"""The end of a run as the clients of its HTTP process meet it: words, no fault of the server."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest

from abbe.daemon.http.exchange.wire import FeedFrame, packed_json
from tests.support.daemon.observed import PATIENCE

pytestmark = pytest.mark.integration

_POST = b"POST /api/v1/switch HTTP/1.1\r\nhost: abbe\r\ncontent-length: 9\r\n\r\n"


class SilentRun:
    """A run that starts the HTTP process, hears what that asks, and answers nothing."""

    def __init__(
        self,
        folder: Path,
        process: asyncio.subprocess.Process,
        ways: tuple[asyncio.StreamReader, asyncio.StreamWriter],
    ) -> None:
        self.socket = folder / "http.sock"
        self.process = process
        self._reader, self._writer = ways

    async def hears(self, what: str) -> None:
        """Until the HTTP process says so once more."""
        while json.loads(await self._reader.readline())["say"] != what:
            pass

    async def dies(self) -> None:
        """As one that is killed; until the HTTP process has ended."""
        self.is_gone()
        await self.process.wait()

    def is_gone(self) -> None:
        self._writer.close()

    async def asks(self, path: str) -> httpx.Response:
        """One client's answer."""
        way = httpx.AsyncHTTPTransport(uds=str(self.socket))
        async with httpx.AsyncClient(transport=way, timeout=PATIENCE) as client:
            return await client.get(f"http://abbe{path}")


@asynccontextmanager
async def silent_run(folder: Path) -> AsyncIterator[SilentRun]:
    mine, its = socket.socketpair()
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "abbe.daemon.http.process", str(its.fileno()),
        pass_fds=(its.fileno(),),
    )  # fmt: skip
    its.close()
    mine.setblocking(False)
    ways = await asyncio.open_unix_connection(sock=mine)
    run = SilentRun(folder, process, ways)
    setup = {
        "socket": str(run.socket), "listen": [], "tokens": str(folder / "tokens.toml"),
        "certificate": None, "key": None, "clients": [], "machine": "mill", "version": "0",
        "pid": os.getpid(), "axes": ["X"], "corrected_axes": ["X"], "directions": ["X"],
        "rotary": [],
    }  # fmt: skip
    ways[1].write(packed_json(FeedFrame.SETUP, setup))
    try:
        async with asyncio.timeout(PATIENCE):
            await run.hears("serving")
            yield run
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        ways[1].close()


async def test_who_waits_for_a_run_that_dies_is_told(tmp_path: Path) -> None:
    """It hung before, so that they wait for answers to several questions."""
    async with silent_run(tmp_path) as run:
        first = asyncio.create_task(run.asks("/healthz"))
        await run.hears("status")
        await asyncio.sleep(1.0)
        waiting = [asyncio.create_task(run.asks(f"/{path}")) for path in ("readyz", "", "metrics")]
        assert (await first).status_code == 503
        waiting.append(asyncio.create_task(run.asks("/api/v1/axes")))
        await run.hears("status")
        await run.dies()
        answers = [await one for one in waiting]
        # metrics have words of their own for a run that says nothing
        assert [a.status_code for a in answers] == [503, 503, 200, 503]
        assert answers[-1].json() == {"detail": "the run is over"}


async def test_who_has_not_asked_to_the_end_is_told(tmp_path: Path) -> None:
    async with silent_run(tmp_path) as run:
        reader, writer = await asyncio.open_unix_connection(str(run.socket))
        writer.write(_POST + b"{")
        await asyncio.sleep(0.2)
        await run.dies()
        answer = await reader.read()
        assert answer.startswith(b"HTTP/1.1 503 ")
        assert b"the run is over" in answer
        writer.close()


async def test_a_stream_comes_to_its_end(tmp_path: Path) -> None:
    async with silent_run(tmp_path) as run:
        stream = asyncio.create_task(run.asks("/api/v1/cycles"))
        await run.hears("cycles")
        await run.dies()
        # one that was cut off would be no answer: its last chunk is missing
        assert (await stream).status_code == 200


async def test_many_who_ask_while_the_computer_has_no_processor(tmp_path: Path) -> None:
    """What they sent waits when the run ends: they get words or a closed connection."""
    async with silent_run(tmp_path) as run:
        pid = run.process.pid
        os.kill(pid, signal.SIGSTOP)
        asking = [asyncio.create_task(run.asks("/healthz")) for _ in range(40)]
        await asyncio.sleep(0.3)
        run.is_gone()
        await asyncio.sleep(0.3)
        os.kill(pid, signal.SIGCONT)
        await run.process.wait()
        answers = await asyncio.gather(*asking, return_exceptions=True)
        for answer in answers:
            if isinstance(answer, BaseException):
                assert isinstance(answer, httpx.TransportError)
            else:
                assert answer.status_code == 503
