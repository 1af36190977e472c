"""The clients of a soak and of a benchmark: at a run's real HTTP process all get what they ask."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from pathlib import Path

import pytest

from abbe.drivers.simulated.soak.client_process import HttpClients
from abbe.drivers.simulated.soak.http_clients import AskingClients, ClientCounts
from tests.daemon.pipeline.test_pipeline import compensating
from tests.support.daemon.observed import free_port, observed, token, until

KINDS = {"health", "metrics", "api", "page", "cycles"}


@pytest.mark.thorough
@pytest.mark.integration
async def test_readers_are_answered_beside_silent_ones_and_rubbish(tmp_path: Path) -> None:
    port, secret = free_port(), token(tmp_path, "soak")
    async with observed(tmp_path, http=f'listen = ["127.0.0.1:{port}"]\n') as found:
        await found.run.until(compensating)
        clients = HttpClients(found.socket, 0.0, port, secret)
        longer = itertools.count(1)
        try:

            async def all_answered() -> bool:
                clients.go()
                await asyncio.sleep(next(longer))
                met = await asyncio.to_thread(clients.rest)
                assert met.wrong == []
                return set(met.answers) == KINDS and met.rubbish > 2 and met.answers["cycles"] > 50

            await until(all_answered)
        finally:
            await asyncio.to_thread(clients.close)
        assert found.run.records[-1].in_full


async def test_a_wrong_answer_is_told(tmp_path: Path) -> None:
    answering: set[asyncio.Task[None]] = set()

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if (mine := asyncio.current_task()) is not None:
            answering.add(mine)
        try:
            asked = await reader.readline()
            event = b'event: cycle\nid: %d\ndata: {"cycle": %d}\n\n'
            content = event % (7, 7) + event % (5, 5)
            status = b"200 OK" if b"cycles" in asked else b"500 Oh"
            length = b"content-length: %d" % len(content)
            writer.write(b"HTTP/1.1 " + status + b"\r\n" + length + b"\r\n\r\n" + content)
        finally:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()

    path = str(tmp_path / "s")
    async with await asyncio.start_unix_server(answer, path):
        clients = AskingClients(path, 0.0)
        clients.go()
        await until(lambda: len(clients.counts.wrong) > 2 and bool(clients.counts.answers))
        await clients.rest()
        # a client that was stopped while it called leaves an answer under way
        await asyncio.gather(*answering)
    assert any("500" in wrong for wrong in clients.counts.wrong)
    assert any("cycle 5 after 7" in wrong for wrong in clients.counts.wrong)


def test_answers_are_counted_by_kind() -> None:
    counts = ClientCounts()
    for path in ("/healthz", "/readyz", "/metrics", "/api/v1/axes", "/", "/api/v1/cycles?every=0"):
        counts.answered(path)
    for number in range(25):
        counts.amiss(f"{number}")
    assert (len(counts.wrong), counts.more) == (20, 5)
    assert counts.answers == {"health": 2, "metrics": 1, "api": 1, "page": 1, "cycles": 1}
