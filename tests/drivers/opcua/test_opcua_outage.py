"""An OPC UA server is lost and comes back, answers late, in pieces, wrongly or not at all."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import pytest

from abbe.drivers.link import LinkState, Quality
from tests.support.drivers.opcua.mill import Mill, linked, mill
from tests.support.drivers.opcua.wire import until_good, wired, x_of
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


@pytest.mark.thorough
async def test_a_server_that_comes_back_with_other_numbers_for_its_namespaces(
    tmp_path: Path,
) -> None:
    with mill(tmp_path) as first:
        async with linked(first.url, {"x": "x"}) as link:
            assert (await x_of(link)).value == 1.5
            first.kill()
            lost = await x_of(link)
            assert lost.quality is Quality.UNAVAILABLE
            assert link.status.state is LinkState.DOWN
            with mill(tmp_path, first.port, other_namespaces=3) as second:
                assert second.namespace == first.namespace + 3
                second.say(x={"value": 8.25})
                assert (await until_good(link)).value == 8.25
                assert link.status.reconnects == 1


async def test_a_late_answer_is_as_old_as_its_question(server: Mill) -> None:
    async with wired(server) as (wire, link):
        offset = time.time() - time.monotonic()
        server.say(x={"clock": True})
        await until_good(link)
        for wire.late in (0.0, 0.3, 0.05, 0.6):
            found = await x_of(link)
            assert found.good
            # the value is the moment at which it was read, ms
            assert found.time <= found.value - offset + 0.002
            assert time.monotonic() - found.time >= wire.late


async def test_an_answer_that_comes_after_its_time_is_never_taken_for_another(
    server: Mill,
) -> None:
    async with wired(server, timeout=0.4, unanswered=1000) as (wire, link):
        offset = time.time() - time.monotonic()
        server.say(x={"clock": True})
        await until_good(link)
        wire.late = 0.6
        for _ in range(3):
            late = await x_of(link)
            assert late.quality is Quality.UNAVAILABLE
            assert "no answer within 0.4 s" in late.reason
        wire.late = 0.0
        found = await until_good(link)
        assert abs(found.time - (found.value - offset)) < 0.4


async def test_an_answer_in_pieces_is_put_together(server: Mill) -> None:
    async with wired(server, timeout=20.0) as (wire, link):
        wire.pieces = 7
        samples = await link.read(("x", "y"))
        assert (samples["x"].value, samples["y"].value) == (1.5, 2.5)


@pytest.mark.parametrize(
    "garbage",
    [
        b"\x00" * 64,
        b"MSGF\xff\xff\xff\x7f" + b"\x01" * 24,
        b"MSGF\x08\x00\x00\x00",
        b"ERRF\x10\x00\x00\x00\x00\x00\x02\x80\xff\xff\xff\xff",
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
    ],
)
async def test_garbage_is_no_value_and_the_link_comes_back(server: Mill, garbage: bytes) -> None:
    async with wired(server, timeout=0.5) as (wire, link):
        await until_good(link)
        wire.garbage = garbage
        spoilt = await x_of(link)
        assert not spoilt.good
        assert (await until_good(link)).value == 1.5


async def test_a_server_that_falls_silent_is_connected_to_anew(server: Mill) -> None:
    async with wired(server, timeout=0.3) as (wire, link):
        await until_good(link)
        wire.silent = True
        assert not (await x_of(link)).good
        assert link.status.state is not LinkState.DOWN
        assert not (await x_of(link)).good
        await until(lambda: link.status.state is LinkState.DOWN)
        wire.silent = False
        assert (await until_good(link)).value == 1.5


async def test_a_connection_that_is_cut_again_and_again_leaves_nothing_behind(
    server: Mill,
) -> None:
    async with wired(server) as (wire, link):
        await until_good(link)
        before = len(asyncio.all_tasks())
        for count in range(1, 4):
            wire.cut()
            while link.status.reconnects < count:
                await x_of(link)
                await asyncio.sleep(0.02)
            await until_good(link)
        # the wire's two tasks of the first connection have ended, those of the last have begun
        await until(lambda: len(asyncio.all_tasks()) <= before)


async def test_more_callers_than_may_wait_are_turned_away_at_once(server: Mill) -> None:
    async with wired(server, max_waiting=2) as (wire, link):
        await until_good(link)
        wire.late = 0.5
        found = await asyncio.gather(*(link.read(("x",)) for _ in range(6)))
        assert link.status.failures == 0
        assert sum("wait for the server already" in f["x"].reason for f in found) > 0


async def test_an_unknown_namespace_is_said(server: Mill) -> None:
    channels = {"x": {"node": "nsu=http://example.org/lathe;s=x"}}
    async with linked(server.url, channels) as link:
        found = await x_of(link)
    assert "no namespace 'http://example.org/lathe'" in found.reason
    assert "http://example.org/mill" in found.reason


async def test_nobody_there(unused_tcp_port: int) -> None:
    async with linked(f"opc.tcp://127.0.0.1:{unused_tcp_port}", {"x": "x"}) as link:
        assert link.status.state is LinkState.DOWN
        assert (await x_of(link)).quality is Quality.UNAVAILABLE
