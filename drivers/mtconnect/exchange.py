"""Questions to an MTConnect agent by HTTP: one at a time, bounded in time and in size."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Iterable
from typing import NamedTuple, SupportsIndex

import h11

from abbe.drivers.link import LinkDownError, LinkProtocolError, LinkTimeoutError

MOST_BYTES = 1 << 19
"""Bytes of one answer beyond which it is none; that of a hundred values has some 20,000."""
_MOST_HEAD = 1 << 14
"""Bytes of an answer's status line and headers."""
_PIECE = 1 << 14
_TURN = 64
"""Pieces of an answer, however small, between two turns of the event loop."""


class AgentAnswer(NamedTuple):
    """What an agent answered.

    Attributes
    ----------
    status
        HTTP's number.
    body
        The document, as bytes.
    asked_at
        When the question left, monotonic, s.
    """

    status: int
    body: bytes
    asked_at: float


class _Incoming(asyncio.StreamReader):
    """What comes, and whether any of it came while nothing was asked."""

    wanted = False
    strays = False

    def feed_data(self, data: Iterable[SupportsIndex]) -> None:
        self.strays = self.strays or not self.wanted
        super().feed_data(data)


class AgentExchange:
    """One connection to an agent, made anew where the agent ended it.

    Parameters
    ----------
    host, port
        Of the agent.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._streams: tuple[_Incoming, asyncio.Transport] | None = None
        self._http = h11.Connection(h11.CLIENT)

    async def ask(self, target: str, seconds: float, most: int = MOST_BYTES) -> AgentAnswer:
        """Get a document.

        Parameters
        ----------
        target
            Path and question.
        seconds
            For all of it: connection, question, answer.
        most
            Bytes of the answer beyond which it is none.

        Raises
        ------
        LinkTimeoutError
            When the whole answer was not there in time.
        LinkDownError
            When there is no connection, or it ended.
        LinkProtocolError
            When what came is no HTTP, too large, or in a coding that was not asked for.
        """
        try:
            async with asyncio.timeout(seconds):
                return await self._ask(target, most)
        except TimeoutError:
            self.drop()
            raise LinkTimeoutError(f"{target}: no whole answer within {seconds:g} s") from None
        except OSError as error:
            self.drop()
            raise LinkDownError(str(error) or type(error).__name__) from None
        except h11.RemoteProtocolError as error:
            self.drop()
            raise LinkProtocolError(f"{target}: what came is no HTTP: {str(error)[:100]}") from None
        except BaseException:
            # a question that was given up: its answer is not that of the next one
            self.drop()
            raise

    async def _ask(self, target: str, most: int) -> AgentAnswer:
        kept = self._streams is not None
        while True:
            try:
                return await self._once(target, most)
            except ConnectionError:
                # a kept connection may have been ended by the agent meanwhile; it is asked twice
                begun = self._http.their_state is not h11.SEND_RESPONSE
                # and not where it was given up here
                if not kept or begun or self._streams is None:
                    raise
                self.drop()
                kept = False

    async def _once(self, target: str, most: int) -> AgentAnswer:
        # whatever is there before the question is no answer to it
        await asyncio.sleep(0)
        if self._streams is not None and self._streams[0].strays:
            self.drop()
        if self._streams is None:
            reader = _Incoming(limit=_PIECE)
            transport, _ = await asyncio.get_running_loop().create_connection(
                lambda: asyncio.StreamReaderProtocol(reader), self._host, self._port
            )
            self._streams = reader, transport
            self._http = h11.Connection(h11.CLIENT, max_incomplete_event_size=_MOST_HEAD)
        reader, transport = self._streams
        host = f"[{self._host}]" if ":" in self._host else self._host
        headers = [
            ("Host", f"{host}:{self._port}"),
            ("Accept", "text/xml, application/xml"),
            ("Accept-Encoding", "identity"),
        ]
        asked = h11.Request(method="GET", target=target, headers=headers)
        asked_at = time.monotonic()
        reader.wanted = True
        transport.write(
            (self._http.send(asked) or b"") + (self._http.send(h11.EndOfMessage()) or b"")
        )
        status, body, events = 0, bytearray(), 0
        while not isinstance(event := self._http.next_event(), h11.EndOfMessage):
            events += 1
            if events % _TURN == 0:
                await asyncio.sleep(0)
            if event is h11.NEED_DATA:
                piece = await reader.read(_PIECE)
                if not piece and self._http.their_state is h11.SEND_RESPONSE:
                    raise ConnectionResetError("the agent ended the connection")
                self._http.receive_data(piece)
            elif isinstance(event, h11.Response):
                status = event.status_code
                _check_coding(target, event)
            elif isinstance(event, h11.Data):
                body += event.data
                if len(body) > most:
                    raise LinkProtocolError(
                        f"{target}: the agent sent too much: more than {most} bytes"
                    )
            elif not isinstance(event, h11.InformationalResponse):
                raise ConnectionResetError("the agent ended the connection")
        reader.wanted = False
        if self._http.our_state is h11.DONE and self._http.their_state is h11.DONE:
            if self._http.trailing_data[0]:
                # nobody asked for it: it would be taken for the next answer
                self.drop()
            else:
                self._http.start_next_cycle()
        else:
            self.drop()
        return AgentAnswer(status, bytes(body), asked_at)

    def drop(self) -> None:
        """End the connection at once; safe to call at any time."""
        streams, self._streams = self._streams, None
        if streams is not None:
            with contextlib.suppress(RuntimeError):
                streams[1].abort()


def _check_coding(target: str, response: h11.Response) -> None:
    for name, value in response.headers:
        if name == b"content-encoding" and value.lower() != b"identity":
            raise LinkProtocolError(f"{target}: coded as {value[:40]!r}, which was not asked for")
        if name == b"content-type" and value.lower().startswith(b"multipart"):
            raise LinkProtocolError(f"{target}: a stream, where one document was asked for")
