"""Tags of an I++ DME session, against a server on a real socket that answers when it is told to."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from abbe.drivers.ipp.errors import ServerError, Severity, StoppedError
from abbe.drivers.ipp.grammar import Named
from abbe.drivers.ipp.session import LAST_TAG, Session
from abbe.drivers.link import LinkDownError, LinkProtocolError, LinkTimeoutError
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

TIMEOUT = 2.0
Script = Callable[[str, str], str]
"""Tag and command → what is sent back."""


class Heard:
    """What a session told, and what the server heard."""

    def __init__(self) -> None:
        self.events: list[tuple[str, str]] = []
        self.errors: list[ServerError] = []
        self.lost: list[str] = []
        self.tags: list[str] = []


@asynccontextmanager
async def session(script: Script) -> AsyncIterator[tuple[Session, Heard]]:
    heard = Heard()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := (await reader.readline()).decode().rstrip():
            tag, command = line.split(" ", 1)
            heard.tags.append(tag)
            writer.write(script(tag, command).encode())
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    made = Session(
        TIMEOUT,
        lambda tag, text: heard.events.append((tag, text)),
        heard.errors.append,
        heard.lost.append,
    )
    try:
        await made.open("127.0.0.1", server.sockets[0].getsockname()[1])
        yield made, heard
    finally:
        await made.end()
        server.close()
        await server.wait_closed()


def answered(tag: str, data: str) -> str:
    return f"{tag} &\r\n{tag} # {data}\r\n{tag} %\r\n"


async def test_the_answer_to_a_command_that_was_given_up_is_not_the_next_one_s() -> None:
    owed: list[str] = []

    def script(tag: str, command: str) -> str:
        if not owed:
            owed.append(tag)
            return ""
        return answered(owed[0], "X(1)") + answered(tag, "X(2)")

    async with session(script) as (made, heard):
        with pytest.raises(LinkTimeoutError, match="no answer in 2 s"):
            await made.ask("Get(X())")
        assert (await made.ask("Get(X())")).data == (Named("X", (2.0,)),)
        assert made.late == 3
        assert heard.tags == ["00001", "00002"]
        assert not heard.errors


async def test_a_tag_that_is_owed_an_answer_is_not_used_again() -> None:
    silent = True

    def script(tag: str, command: str) -> str:
        return "" if silent else answered(tag, "X(1)")

    async with session(script) as (made, heard):
        with pytest.raises(LinkTimeoutError):
            await made.ask("Get(X())")
        silent = False
        made._number = LAST_TAG - 1
        await made.ask("Get(X())")
        await made.ask("Get(X())")
        assert heard.tags == ["00001", "99999", "00002"]


async def test_commands_at_the_same_time_get_their_own_answers() -> None:
    waiting: list[str] = []

    def script(tag: str, command: str) -> str:
        waiting.append(answered(tag, f"X({int(tag)})"))
        return "".join(reversed(waiting)) if len(waiting) == 3 else ""

    async with session(script) as (made, _):
        replies = await asyncio.gather(*(made.ask("Get(X())") for _ in range(3)))
        assert [reply.data for reply in replies] == [(Named("X", (n,)),) for n in (1.0, 2.0, 3.0)]


async def test_several_lines_of_data_and_warnings_are_one_reply() -> None:
    def script(tag: str, command: str) -> str:
        return (
            f"{tag} &\r\n{tag} # X(1)\r\n"
            f'{tag} ! Error(1, 0504, "Get", "w")\r\n{tag} # Y(2)\r\n{tag} %\r\n'
        )

    async with session(script) as (made, _):
        reply = await made.ask("Get(X(), Y())")
        assert reply.data == (Named("X", (1.0,)), Named("Y", (2.0,)))
        assert [w.number for w in reply.warnings] == [504]


async def test_an_event_s_data_is_never_a_reply_even_before_its_command_is_completed() -> None:
    def script(tag: str, command: str) -> str:
        return f"{tag} &\r\n{tag} # X(1)\r\n{tag} %\r\n{tag} # X(2)\r\n"

    async with session(script) as (made, heard):
        assert (await made.ask("OnMoveReportE(X())", "E0007")).data == ()
        await until(lambda: len(heard.events) == 2)
        assert heard.events == [("E0007", "X(1)"), ("E0007", "X(2)")]


async def test_errors_by_severity_with_and_without_completion() -> None:
    texts = iter(
        [
            '{0} ! Error(3, 2500, "Get", "limit")\r\n{0} %\r\n',
            '{0} ! Error(2, 0514, "Get", "clear")\r\n',
            "{0} # X(1\r\n{0} %\r\n",
            '{0} ! Error(9, 0503, "Get", "gone")\r\n',
        ]
    )
    async with session(lambda tag, _: next(texts).format(tag)) as (made, heard):
        with pytest.raises(StoppedError, match="critical error 2500 of Get: limit"):
            await made.ask("Get(X())")
        with pytest.raises(StoppedError, match="error 0514"):
            await made.ask("Get(X())")
        with pytest.raises(LinkProtocolError, match="at character"):
            await made.ask("Get(X())")
        with pytest.raises(LinkDownError, match="fatal error 0503"):
            await made.ask("Get(X())")
        assert not heard.errors


async def test_an_error_of_nobody_s_command_is_reported() -> None:
    def script(tag: str, command: str) -> str:
        return f'E0000 ! Error(2, 1003, "PtMeas", "No touch")\r\n{tag} %\r\n'

    async with session(script) as (made, heard):
        assert (await made.ask("StartSession()")).data == ()
        (error,) = heard.errors
        assert (error.severity, error.number) == (Severity.ERROR, 1003)


async def test_a_server_that_hangs_up_is_lost_once_and_nothing_waits() -> None:
    closing = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        closing.set()
        writer.close()

    lost: list[str] = []
    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        made = Session(60.0, lambda tag, text: None, lambda error: None, lost.append)
        await made.open("127.0.0.1", server.sockets[0].getsockname()[1])
        with pytest.raises(LinkDownError, match="closed the connection"):
            async with asyncio.timeout(20.0):
                await made.ask("StartSession()")
        assert lost == ["the server closed the connection"]
        with pytest.raises(LinkDownError, match="connection is closed"):
            await made.ask("Get(X())")
        await made.end()


async def test_a_host_that_is_not_there() -> None:
    made = Session(1.0, lambda tag, text: None, lambda error: None, lambda why: None)
    with pytest.raises(LinkDownError, match="no connection"):
        await made.open("127.0.0.1", 1)
    with pytest.raises(LinkDownError, match="the connection is closed"):
        await made.ask("Get(X())")
