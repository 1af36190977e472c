"""Clients that do not read, do not ask, or send rubbish: they harm themselves only."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import random
import re
import signal
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn

from abbe.daemon.control.controls import Controls
from abbe.daemon.control.requests import StateRequest
from abbe.daemon.http import bounded
from abbe.daemon.http.cycles import hub
from abbe.daemon.http.cycles.hub import Hub, SilentRunError, Subscription
from abbe.daemon.http.exchange import feed
from abbe.daemon.http.exchange.feed import Feed
from abbe.daemon.http.exchange.wire import next_frame, unpacked_cycles
from tests.daemon.pipeline.test_live_control import running
from tests.daemon.pipeline.test_pipeline import compensating
from tests.support.daemon.live_run import compensating as full
from tests.support.daemon.live_run import live_run, machine
from tests.support.daemon.observed import PATIENCE, events, observed, until

pytestmark = pytest.mark.integration


async def test_who_stops_reading_loses_cycles_and_is_told_how_many(tmp_path: Path) -> None:
    """Nothing is missing that was not counted, and who reads loses nothing meanwhile."""
    async with observed(tmp_path) as found, found.client() as client, found.client() as other:
        await found.run.until(compensating)
        request = {"every": 0}
        async with client.stream("GET", "/api/v1/cycles", params=request) as lazy:
            reading = events(lazy)
            first = int((await anext(reading))[1])

            async def lost() -> bool:
                text = (await other.get("/metrics")).text
                line = next(
                    t for t in text.splitlines() if t.startswith("abbe_http_dropped_cycles")
                )
                return float(line.split()[-1]) > 20.0

            seen = []
            async with other.stream("GET", "/api/v1/cycles", params=request) as attentive:
                async for kind, number, _ in events(attentive):
                    assert kind == "cycle"
                    seen.append(int(number))
                    if len(seen) % 200 == 0 and await lost():
                        break
            assert seen == list(range(seen[0], seen[0] + len(seen)))
            at, missing, skipped = first, 0, 0
            async for kind, number, data in reading:
                if kind == "dropped":
                    missing += json.loads(data)["dropped"]
                else:
                    skipped += int(number) - at - 1
                    at = int(number)
                if at > seen[-1]:
                    break
            assert missing == skipped >= 20
            assert all(map(compensating, found.run.records[-500:]))


def test_a_full_queue_lets_the_oldest_go() -> None:
    async def story() -> None:
        one = Subscription(0.0)
        for number in range(hub._QUEUE + 10):
            one.put(0.01 * number, number, b"x", 0)
        taken, lost = await one.take(0.0)
        assert lost == one.dropped == 10
        assert [number for number, _ in taken] == list(range(10, hub._QUEUE + 10))
        one.put(99.0, 7, b"x", 3)
        assert (await one.take(0.0))[1] == 3
        assert await one.take(0.01) == ([], 0)

    asyncio.run(story())


async def test_rubbish(tmp_path: Path) -> None:
    """Bytes of no protocol, heads without an end, bodies without end: answered or cut off."""
    async with observed(tmp_path) as found, found.client() as client:
        await found.run.until(compensating)
        dice = random.Random(7)
        post = b"POST /api/v1/switch HTTP/1.1\r\nhost: a\r\n"
        whole = post + b'content-length: 9\r\n\r\n{"a": 1}\n'
        upgrade = b"upgrade: websocket\r\nconnection: upgrade\r\n\r\n"
        pieces = [
            dice.randbytes(4096),
            b"\x16\x03\x01" + dice.randbytes(512),
            b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * 10_000,
            b"GET " + b"/a" * 40_000,
            b"GET / HTTP/9.9\r\n\r\n",
            b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
            post + b"content-length: 99999999\r\n\r\n" + b"x" * 200_000,
            post + b"transfer-encoding: chunked\r\n\r\nzz\r\n",
            b"GET /api/v1/status HTTP/1.1\r\nhost: a\r\n\r\n" * 500,
            b"GET /%00/../../etc/passwd HTTP/1.1\r\nhost: a\r\n\r\n",
            b"GET /metrics HTTP/1.1\r\nhost: a\r\n" + upgrade,
            *(whole[:at] + dice.randbytes(3) + whole[at + 3 :] for at in range(0, len(whole), 5)),
            *(dice.randbytes(dice.randrange(1, 300)) + b"\r\n\r\n" for _ in range(100)),
        ]
        before = len(found.run.records)

        async def send(piece: bytes) -> None:
            with contextlib.suppress(OSError, TimeoutError):
                reader, writer = await asyncio.open_unix_connection(str(found.socket))
                writer.write(piece)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(0.3):
                        await reader.read(1000)
                writer.transport.abort()

        for start in range(0, len(pieces), 20):
            await asyncio.gather(*map(send, pieces[start : start + 20]))
        assert (await client.get("/healthz")).status_code == 200
        answer = await client.post(
            "/api/v1/switch", content=b"x" * 70_000, headers={"content-type": "application/json"}
        )
        assert answer.status_code == 413
        assert all(map(compensating, found.run.records[before:]))


@asynccontextmanager
async def served(
    app: Any, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[tuple[uvicorn.Server, int]]:
    """uvicorn with bounded connections in this process, impatient; and its port."""
    monkeypatch.setattr(bounded, "HEAD_WITHIN", 0.3)
    monkeypatch.setattr(bounded, "READ_WITHIN", 0.3)
    monkeypatch.setattr(bounded, "MOST", 10)
    config = uvicorn.Config(
        app, port=0, http=bounded.BoundedProtocol, ws="none", lifespan="off", log_config=None,
        timeout_keep_alive=1,
    )  # fmt: skip
    server = uvicorn.Server(config)
    server.capture_signals = contextlib.nullcontext  # type: ignore[method-assign]
    made = socket.create_server(("127.0.0.1", 0))
    task = asyncio.create_task(server.serve([made]))
    await until(lambda: server.started)
    yield server, made.getsockname()[1]
    server.should_exit = True
    await task


async def closed(reader: asyncio.StreamReader) -> bytes:
    """All that comes until the other side hangs up."""
    found = b""
    with contextlib.suppress(ConnectionError):
        async with asyncio.timeout(PATIENCE):
            while part := await reader.read(65536):
                found += part
    return found


async def say_ok(_scope: Any, _receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"ok"})


async def test_who_asks_nothing_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    async with served(say_ok, monkeypatch) as (_, port):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        assert await closed(reader) == b""
        writer.close()
        # a head that drips
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        dripping = asyncio.create_task(_drip(writer))
        assert await closed(reader) == b""
        dripping.cancel()
        writer.close()
        # a first request in time, then half of a second one
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"GET / HTTP/1.1\r\nhost: a\r\n\r\nGET / HT")
        assert (await closed(reader)).endswith(b"ok\r\n0\r\n\r\n")
        writer.close()


async def _drip(writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError):
        for byte in b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * 1000:
            writer.write(bytes((byte,)))
            await asyncio.sleep(0.02)


async def test_who_reads_nothing_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    async def without_end(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        for _ in range(2000):
            await send({"type": "http.response.body", "body": bytes(65536), "more_body": True})

    async with served(without_end, monkeypatch) as (server, port):
        with socket.create_connection(("127.0.0.1", port)) as lazy:
            lazy.sendall(b"GET / HTTP/1.1\r\nhost: a\r\n\r\n")
            await until(lambda: len(server.server_state.connections) == 1)
            await until(lambda: not server.server_state.connections)
            # he did not hang up, and most of it was never sent
            lazy.setblocking(True)
            lazy.settimeout(PATIENCE)
            got = await asyncio.to_thread(_rest, lazy)
            assert got < 2000 * 65536 / 2


def _rest(lazy: socket.socket) -> int:
    got = 0
    with contextlib.suppress(ConnectionError):
        while part := lazy.recv(1 << 20):
            got += len(part)
    return got


async def test_who_owes_a_request_makes_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """Silence on many connections shuts nobody out who says what he wants."""
    async with served(say_ok, monkeypatch) as (_, port):
        monkeypatch.setattr(bounded, "HEAD_WITHIN", PATIENCE)
        silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(30)]
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE) as one:
            assert (await one.get("/")).status_code == 200
        for _, writer in silent:
            writer.close()


async def test_too_many_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    async def slow(_scope: Any, _receive: Any, send: Any) -> None:
        await asyncio.sleep(0.5)
        await say_ok(_scope, _receive, send)

    async with served(slow, monkeypatch) as (_, port):
        base = f"http://127.0.0.1:{port}"
        async with httpx.AsyncClient(base_url=base, timeout=PATIENCE) as many:
            got = await asyncio.gather(*(many.get("/") for _ in range(30)), return_exceptions=True)
        assert any(isinstance(g, httpx.Response) and g.status_code == 200 for g in got)
        assert any(isinstance(g, httpx.TransportError) for g in got)
        async with httpx.AsyncClient(base_url=base, timeout=PATIENCE) as again:
            assert (await again.get("/")).status_code == 200


@asynccontextmanager
async def fed(folder: Path) -> AsyncIterator[tuple[Any, Feed, socket.socket]]:
    """A run and its feed, whose other end is this test."""
    async with running(folder) as run:
        await run.until(compensating)
        mine, its = socket.socketpair()
        mine.setblocking(False)
        reader, writer = await asyncio.open_unix_connection(sock=mine)
        made = Feed(run.service.pipeline, Controls(run.service), may_operate=True)
        task = asyncio.create_task(made.run(reader, writer, {}))
        try:
            yield run, made, its
        finally:
            its.close()
            await asyncio.wait_for(task, PATIENCE)
            writer.close()


async def test_a_process_that_does_not_read_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it does not take is dropped within bounds, and counted when it reads again."""
    monkeypatch.setattr(feed, "_WAITING", 20_000)
    async with fed(tmp_path) as (run, made, its):
        its.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        its.sendall(b'{"say": "cycles", "every": 0}\n')
        await until(lambda: made.dropped > 100)
        writer = made._writer
        assert writer is not None
        assert writer.transport.get_write_buffer_size() < 3 * 20_000
        number = run.records[-1].number
        await run.until(lambda r: r.number > number + 20)
        its.setblocking(False)
        reader, other = await asyncio.open_unix_connection(sock=its.dup())
        numbers, dropped = [], 0
        async with asyncio.timeout(PATIENCE):
            while not dropped:
                kind, content = await next_frame(reader)
                if kind.name == "CYCLES":
                    for cycle in unpacked_cycles(content):
                        dropped += cycle.dropped
                        if dropped:
                            assert dropped == cycle.number - numbers[-1] - 1
                            break
                        numbers.append(cycle.number)
        assert dropped > 100
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        other.close()


@pytest.mark.parametrize(
    "line",
    [
        b"rubbish\n",
        b'{"say": "format the disk"}\n',
        b'{"say": "cycles", "every": -1}\n',
        b'{"say": "do", "number": 1, "who": "x", "request": {"do": "rm"}}\n',
        b"x" * 1_000_000 + b"\n",
        b"\xff\xfe\n",
    ],
    ids=["words", "unknown", "negative", "foreign", "endless", "bytes"],
)
async def test_a_process_that_sends_rubbish_is_let_go(
    tmp_path: Path, line: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async with fed(tmp_path) as (run, made, its):
        await asyncio.to_thread(_sendall, its, line)
        await until(lambda: made._writer is None)
        number = run.records[-1].number
        await run.until(lambda r: r.number > number + 20)
        assert compensating(run.records[-1])
    assert "sends what is no request" in caplog.text


def _sendall(its: socket.socket, line: bytes) -> None:
    with contextlib.suppress(OSError):
        its.sendall(line)


async def test_a_process_that_floods_is_read_slowly(tmp_path: Path) -> None:
    async with fed(tmp_path) as (run, made, its):
        flood = b'{"say": "status"}\n{"say": "event", "level": 30, "text": "x"}\n' * 20
        its.setblocking(False)
        number, sent = run.records[-1].number, 0
        async with asyncio.timeout(PATIENCE):
            while sent <= 100_000:
                with contextlib.suppress(BlockingIOError):
                    sent += its.send(flood)
                await asyncio.sleep(0.001)
        assert made._messages <= feed._MESSAGES + 1
        await run.until(lambda r: r.number > number + 50)
        assert compensating(run.records[-1])


def test_a_run_that_is_killed_takes_its_http_process_with_it(tmp_path: Path) -> None:
    with machine(tmp_path) as (_, config):
        config.write_text(config.read_text() + "\n[http]\n")
        with live_run(config) as run:
            run.until(full)
            _listens(tmp_path / "http.sock")
            way = httpx.HTTPTransport(uds=str(tmp_path / "http.sock"))
            with httpx.Client(transport=way, base_url="http://abbe", timeout=PATIENCE) as client:
                assert client.get("/readyz").status_code == 200
                text = client.get("/metrics").text
            assert re.search(r"^abbe_corrected_in_full 1", text, re.MULTILINE)
            children = Path(f"/proc/{run.process.pid}/task").glob("*/children")
            (child,) = {int(p) for file in children for p in file.read_text().split()}
            assert os.getpriority(os.PRIO_PROCESS, child) >= 10
            run.process.send_signal(signal.SIGKILL)
            deadline = time.monotonic() + PATIENCE
            while _lives(child):
                assert time.monotonic() < deadline
                time.sleep(0.05)


def _listens(path: Path) -> None:
    deadline = time.monotonic() + PATIENCE
    while True:
        with socket.socket(socket.AF_UNIX) as asking:
            try:
                asking.connect(str(path))
            except OSError:
                assert time.monotonic() < deadline
                time.sleep(0.05)
            else:
                return


def _lives(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


async def test_who_asks_while_the_run_dies_is_told_so() -> None:
    """A cancelled request would be an internal error."""
    mine, its = socket.socketpair()
    reader, writer = await asyncio.open_unix_connection(sock=its)
    hub = Hub(reader, writer)
    taking = asyncio.create_task(hub.run())
    asking = asyncio.create_task(hub.status())
    changing = asyncio.create_task(hub.do(StateRequest(), "me"))
    await until(lambda: len(hub._answers) == 1)
    mine.close()
    for asked in (asking, changing):
        with pytest.raises(SilentRunError, match="the run is over"):
            await asked
    with pytest.raises(SilentRunError, match="the run is over"):
        await hub.status()
    await taking
    writer.close()
