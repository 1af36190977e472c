"""Agents that lie, drip, flood, or fall silent: they cost no value, memory or cycle."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import time
import tracemalloc
from collections.abc import Iterable, Iterator

import pytest

from abbe.drivers.link import LinkState, Quality
from tests.support.drivers.mtconnect.agent import MillAgent, http, linked, serving
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE MTConnectStreams [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY a{n} "{f"&a{n - 1 or str()};" * 10}">' for n in range(1, 9))
    + "]><MTConnectStreams>&a8;</MTConnectStreams>"
)
EXTERNAL = (
    '<!DOCTYPE MTConnectStreams [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
    "<MTConnectStreams>&a;</MTConnectStreams>"
)
STREAM = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n"


def without_end() -> Iterator[bytes]:
    """More and more, though never an end."""
    yield STREAM
    body = b"<MTConnectStreams>" + b"x" * 65518
    while True:
        yield b"%x\r\n" % len(body) + body + b"\r\n"


def claimed() -> Iterator[bytes]:
    """Two gigabytes are announced, and come."""
    yield b"HTTP/1.1 200 OK\r\nContent-Length: 2000000000\r\n\r\n"
    while True:
        yield bytes(65536)


def bits() -> Iterator[bytes]:
    """An answer of pieces of one byte."""
    yield STREAM
    while True:
        yield b"1\r\nx\r\n" * 10000


def drip() -> Iterator[bytes]:
    """A byte at a time: something always comes."""
    yield STREAM
    while True:
        time.sleep(0.02)
        yield b"1\r\n \r\n"


WRONG: dict[str, tuple[Iterable[bytes], str]] = {
    "entities in entities": ([http(LAUGHS)], "DTD"),
    "an entity from a file": ([http(EXTERNAL)], "DTD"),
    "no end": (without_end(), "sent too much"),
    "2 GB": (claimed(), "sent too much"),
    "headers without end": (itertools.chain([b"HTTP/1.1 200 OK\r\n"],
                                            itertools.repeat(b"a: b\r\n" * 1000)), "no HTTP"),
    "no HTTP": ([b"\x00\x01\x02garbage\r\n\r\n"], "no HTTP"),
    "no XML": ([http("{}")], "no XML"),
    "half a document": ([http("<MTConnectStreams><Header")], "no XML"),
    "another document": ([http("<html><body>hello</body></html>")], "no document of MTConnect"),
    "a page of errors": ([http("<html/>", "500 Internal")], "HTTP 500"),
    "an entity's encoding": ([http('<?xml version="1.0" encoding="idna"?><a/>')], "no XML"),
    "deep": ([http("<MTConnectStreams>" + "<a>" * 100000)], "within each other"),
    "no header": ([http("<MTConnectStreams/>")], "instanceId"),
    "a number of a million digits": (
        [http(f'<MTConnectStreams><Header instanceId="{"9" * 100000}"/></MTConnectStreams>')],
        "expected a number",
    ),
    "refused": (
        [http('<MTConnectError><Header/><Errors><Error errorCode="INTERNAL_ERROR">oh</Error>'
              "</Errors></MTConnectError>")], "INTERNAL_ERROR: oh"),
    "packed": ([http("x", more="Content-Encoding: gzip\r\n")], "not asked for"),
    "a stream": (
        [b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=a\r\n\r\n"],
        "a stream",
    ),
    "cut off": ([b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n<MTC", b""], ""),
    "redirected": ([http("", "302 Found", "Location: http://192.0.2.1/\r\n")], "HTTP 302"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
async def test_what_is_wrong_is_no_value_and_ends(agent: MillAgent, name: str) -> None:
    answer, why = WRONG[name]
    async with linked(agent) as link:
        assert (await link.read(("x",)))["x"].good
        agent.instead = lambda target: answer if "/sample" in target else None
        tracemalloc.start()
        try:
            found = await link.read(("x", "T"))
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert not found["x"].good
        assert not found["T"].good
        assert why in found["x"].reason
        assert len(found["x"].reason) < 400
        assert most < 8e6
        agent.instead = lambda target: None
        agent.say(Xact="5")
        await until(lambda: link.status.state is LinkState.UP)
        assert (await link.read(("x",)))["x"].value == 5.0


@pytest.mark.parametrize("answer", [drip, bits])
async def test_who_drips_is_given_up_in_time_and_nobody_waits_for_it(
    agent: MillAgent, answer: object
) -> None:
    async with linked(agent, timeout=0.5) as link:
        agent.instead = lambda target: answer() if "/sample" in target else None  # type: ignore[operator]
        gaps: list[float] = []

        async def others() -> None:
            last = time.monotonic()
            while True:
                await asyncio.sleep(0.001)
                now = time.monotonic()
                gaps.append(now - last)
                last = now

        other = asyncio.create_task(others())
        began = time.monotonic()
        found = await link.read(("x",))
        took = time.monotonic() - began
        other.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await other
        assert not found["x"].good
        assert found["x"].quality in (Quality.UNAVAILABLE, Quality.BAD)
        assert took < 2.0
        # others had their turns: a wait on the spot would leave a handful
        assert len(gaps) > 20


async def test_an_answer_after_its_time_is_not_that_of_the_next_question(agent: MillAgent) -> None:
    async with linked(agent, timeout=0.3) as link:
        old = agent.answer("/Mill/sample?from=14&count=64")

        def late(target: str) -> list[bytes] | None:
            if "/sample" not in target:
                return None
            time.sleep(0.5)
            return [old]

        agent.instead = late
        found = await link.read(("x",))
        assert found["x"].quality is Quality.UNAVAILABLE
        assert "no whole answer within 0.3 s" in found["x"].reason
        agent.instead = lambda target: None
        agent.say(Xact="6")
        await until(lambda: link.status.state is LinkState.UP)
        assert (await link.read(("x",)))["x"].value == 6.0


async def test_what_nobody_asked_for_is_no_answer(agent: MillAgent) -> None:
    async with linked(agent) as link:
        twice = agent.streams(
            [
                '<Position dataItemId="Xact" sequence="900" timestamp="2026-01-01T00:00:00Z">66'
                "</Position>"
            ],
            901,
        )

        def double(target: str) -> Iterator[bytes]:
            yield agent.answer(target)
            time.sleep(0.1)
            yield http(twice)

        agent.instead = double
        assert (await link.read(("x",)))["x"].value == 1.5
        await asyncio.sleep(0.3)
        agent.instead = lambda target: None
        assert (await link.read(("x",)))["x"].value == 1.5
        assert agent.connections == 2


async def test_a_kept_connection_that_ended_costs_nothing(agent: MillAgent) -> None:
    async with linked(agent) as link:
        agent.instead = lambda target: [agent.answer(target), b""]
        assert (await link.read(("x",)))["x"].good
        await asyncio.sleep(0.05)
        assert (await link.read(("x",)))["x"].good
        assert link.status.failures == 0
        # of those that say so, and those of HTTP 1.0
        agent.instead = lambda target: [
            agent.answer(target).replace(b"HTTP/1.1", b"HTTP/1.0").replace(b"Length: ", b"L: "), b""
        ]  # fmt: skip
        for _ in range(3):
            assert (await link.read(("x",)))["x"].good
        assert link.status.reconnects == 0


async def test_an_agent_that_goes_and_comes(agent: MillAgent) -> None:
    mine = MillAgent()
    mine.say(Xact="1", Stemp="20")
    with serving(mine):
        link = linked(mine)
        opened = await link.__aenter__()
    try:
        found = await opened.read(("x",))
        assert found["x"].quality is Quality.UNAVAILABLE
        assert opened.status.state is LinkState.DOWN
        with serving(mine):
            mine.say(Xact="2")
            await until(lambda: opened.status.state is LinkState.UP)
            assert (await opened.read(("x",)))["x"].value == 2.0
    finally:
        await link.__aexit__(None, None, None)
    # closed, it is asked nothing more
    assert not (await opened.read(("x",)))["x"].good


async def test_calls_beyond_those_that_may_wait_are_turned_away(agent: MillAgent) -> None:
    async with linked(agent, max_waiting=2) as link:
        agent.instead = lambda target: time.sleep(0.2)
        found = await asyncio.gather(*(link.read(("x",)) for _ in range(4)))
        assert [one["x"].good for one in found] == [True, True, False, False]
        assert "2 calls wait" in found[3]["x"].reason


async def test_a_question_given_up_leaves_no_answer_behind(agent: MillAgent) -> None:
    async with linked(agent) as link:
        agent.instead = lambda target: time.sleep(0.3)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(link.read(("x",)), 0.1)
        agent.instead = lambda target: None
        agent.say(Xact="3")
        assert (await link.read(("x",)))["x"].value == 3.0
        assert link.status.failures == 0
