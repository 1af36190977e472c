"""What a service leaves to Python's collector does not lie there by the thousand."""

from __future__ import annotations

import asyncio
import gc
import weakref

from abbe.daemon.collector import as_a_service, seldom


class _InACircle:
    """As asyncio's transports are: it holds a method of itself."""

    def __init__(self) -> None:
        self.ready = self.look

    def look(self) -> None:
        """Nothing."""


def _most_that_lie_there(count: int = 6000) -> int:
    there: weakref.WeakSet[_InACircle] = weakref.WeakSet()
    most = 0
    for _ in range(count):
        there.add(_InACircle())
        most = max(most, len(there))
    return most


def test_a_service_collects_what_is_new_at_once_and_a_command_does_not() -> None:
    before = gc.get_threshold()
    try:
        seldom()
        gc.collect()
        assert _most_that_lie_there() > 5000
        with as_a_service():
            assert _most_that_lie_there() < 1000
        gc.collect()
        assert _most_that_lie_there() > 5000
    finally:
        gc.set_threshold(*before)
        gc.collect()


def test_what_is_there_when_a_service_begins_is_not_walked_through_again() -> None:
    kept = [[number] for number in range(50_000)]
    assert gc.get_freeze_count() == 0
    with as_a_service():
        assert gc.get_freeze_count() > 50_000
        assert len(gc.get_objects()) < 50_000
    assert gc.get_freeze_count() == 0
    assert len(kept) == 50_000


def test_closed_connections_of_asyncio_do_not_pile_up() -> None:
    async def serve(most: int) -> int:
        transports: weakref.WeakSet[asyncio.WriteTransport] = weakref.WeakSet()

        async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            transports.add(writer.transport)
            writer.write(await reader.readline())
            writer.close()

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        greatest = 0
        async with server:
            for _ in range(most):
                reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
                writer.write(b"status\n")
                await reader.read()
                writer.close()
                greatest = max(greatest, len(transports))
        return greatest

    before = gc.get_threshold()
    seldom()
    try:
        with as_a_service():
            assert asyncio.run(serve(400)) < 200
    finally:
        gc.set_threshold(*before)
