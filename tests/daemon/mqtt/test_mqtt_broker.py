"""What waits reaches a real Mosquitto: nothing lost, and in order, whatever happens to it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from abbe.daemon.mqtt.messages import Message
from abbe.daemon.mqtt.publisher import Publisher
from abbe.daemon.mqtt.spool import Spool
from tests.support.daemon.broker import SECRET, Mosquitto, Subscriber, mosquitto
from tests.support.drivers.opening import until

pytestmark = [
    pytest.mark.integration,
    # paho leaves a socket whose TLS failed to the collector
    pytest.mark.filterwarnings("ignore:unclosed <ssl.SSLSocket:ResourceWarning"),
]

ACL = "user abbe\ntopic write plant/mill/#\nuser reader\ntopic read #\n"


class Gate:
    """Lies before the broker; closed, it lets nobody through.

    Attributes
    ----------
    open
        Whether connections are let through.
    silent
        Whether they are taken, and nothing is ever answered.
    said
        Bytes that are said in the broker's place, once, at each connection.
    """

    def __init__(self, broker: Mosquitto) -> None:
        self._broker = broker
        self.port = 0
        self.open, self.silent, self.said = True, False, b""
        self.connections = 0
        self._tasks: set[asyncio.Task[None]] = set()
        self._writers: set[asyncio.StreamWriter] = set()

    @asynccontextmanager
    async def standing(self) -> AsyncIterator[Gate]:
        listening = await asyncio.start_server(self._take, "127.0.0.1", 0)
        self.port = listening.sockets[0].getsockname()[1]
        try:
            yield self
        finally:
            listening.close()
            self.cut()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    def cut(self) -> None:
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        self._writers.add(writer)
        if self.said:
            writer.write(self.said)
        if self.silent or self.said:
            return
        if not self.open:
            writer.close()
            return
        try:
            theirs, ours = await asyncio.open_connection("127.0.0.1", self._broker.port)
        except OSError:
            writer.close()
            return
        self._writers.add(ours)
        for pair in ((reader, ours), (theirs, writer)):
            self._tasks.add(asyncio.create_task(_hand_on(*pair)))


async def _hand_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(65536):
            writer.write(data)
    writer.close()


class Publishing:
    """A publisher at work, its spool, and what it said."""

    def __init__(self, folder: Path, port: int, broker: Mosquitto | None, **keys: Any) -> None:
        secret = folder / "secret"
        secret.write_text(f"{SECRET}\n", "utf-8")
        secret.chmod(0o600)
        self.said: list[tuple[int, str]] = []
        self.spool = Spool(folder / "mqtt.sqlite", 50_000_000, lambda t: self.said.append((30, t)))
        task = {
            "host": "127.0.0.1", "port": port, "tls": bool(broker and broker.ca),
            "topic": "plant/mill", "client_id": "abbe-mill", "user": None, "version": "5",
            "timeout": 5.0, "reconnect_min": 0.01, "reconnect_max": 0.04,
            "password_file": str(secret),
        } | keys  # fmt: skip
        if broker and broker.ca:
            task["ca"] = str(broker.ca)
        about = {"machine": "mill"}
        self.publisher = Publisher(task, self.spool, about, lambda *s: self.said.append(s))

    @asynccontextmanager
    async def at_work(self) -> AsyncIterator[Publishing]:
        task = asyncio.create_task(self.publisher.run())
        try:
            yield self
        finally:
            self.publisher.end()
            await asyncio.wait({task}, timeout=10.0)
            task.cancel()
            await asyncio.wait({task})
            self.spool.close()

    def put(self, count: int, topic: str = "events") -> None:
        for _ in range(count):
            self.publisher.put(Message(topic, {"text": "x" * 100}, retain=False))


def first_ids(subscriber: Subscriber) -> list[int]:
    """Ids in the order in which each was first heard."""
    return list(dict.fromkeys(body["id"] for body in subscriber.bodies("/events")))


@pytest.mark.parametrize("kills", [10, pytest.param(50, marks=pytest.mark.thorough)])
async def test_nothing_is_lost_and_all_in_order_with_a_broker_killed_again_and_again(
    tmp_path: Path, kills: int
) -> None:
    subscriber = Subscriber()
    with mosquitto(tmp_path, tls=True, acl=ACL) as broker:
        async with Gate(broker).standing() as gate:
            gate.open = False
            publishing = Publishing(tmp_path, gate.port, broker, user="abbe")
            async with publishing.at_work():
                for _ in range(kills):
                    heard = len(subscriber.heard)
                    # who subscribes later has missed what the broker took: that is MQTT's
                    async with subscriber.listening(broker, user="reader"):
                        gate.open = True
                        publishing.put(40)
                        await until(lambda heard=heard: len(subscriber.heard) > heard + 10)
                        gate.open = False
                        broker.kill()
                        # what it said before it died is still heard
                        await asyncio.sleep(0)
                        gate.cut()
                        publishing.put(10)
                        await until(subscriber.deaf.is_set)
                    broker.begin()
                async with subscriber.listening(broker, user="reader"):
                    gate.open = True
                    await until(lambda: first_ids(subscriber)[-1:] == [50 * kills])
                    await until(lambda: not publishing.spool.oldest(1))
    assert first_ids(subscriber) == list(range(1, 50 * kills + 1))
    assert publishing.spool.lost == publishing.publisher.refused == 0
    assert len({body["series"] for body in subscriber.bodies("/events")}) == 1


async def test_birth_and_death(tmp_path: Path) -> None:
    subscriber = Subscriber()
    with mosquitto(tmp_path) as broker:
        async with Gate(broker).standing() as gate:
            async with subscriber.listening(broker):
                async with Publishing(tmp_path, gate.port, broker).at_work():
                    await until(lambda: len(subscriber.heard) == 1)
                    gate.cut()
                    # the broker says that it died, then it is back
                    await until(lambda: len(subscriber.heard) >= 3)
                await until(lambda: len(subscriber.heard) >= 4)
            later = Subscriber()
            async with later.listening(broker):
                await until(lambda: later.heard)
    lives = subscriber.bodies("mill/online")
    assert [life["online"] for life in lives] == [True, False, True, False]
    assert [life["connection"] for life in lives] == [1, 1, 2, 2]
    # whoever asks later is told
    assert later.heard[0][2]
    assert later.bodies("mill/online")[0]["online"] is False


async def test_topics_that_the_access_list_forbids_are_said_and_block_nothing(
    tmp_path: Path,
) -> None:
    subscriber = Subscriber()
    with mosquitto(tmp_path, acl=ACL.replace("#\nuser", "state\nuser", 1)) as broker:
        async with subscriber.listening(broker, user="reader"):
            publishing = Publishing(tmp_path, broker.port, broker, user="abbe")
            async with publishing.at_work():
                publishing.put(3)
                publishing.put(1, "state")
                await until(lambda: subscriber.bodies("/state"))
    assert subscriber.bodies("/events") == []
    # the three, birth and death
    assert publishing.publisher.refused == 5
    assert [s for s in publishing.said if "Not authorized" in s[1]]


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"user": "nobody"}, "Not authorized"),
        ({"ca": None}, "certificate verify failed"),
        ({"host": "localhost"}, "certificate verify failed"),
        ({"tls": False, "timeout": 0.4}, ""),
        ({"password_file": "/dev/null"}, "chmod 600"),
    ],
)
async def test_who_is_not_let_in_says_so_and_goes_on_trying(
    tmp_path: Path, keys: dict[str, Any], why: str
) -> None:
    with mosquitto(tmp_path, tls=True, acl=ACL) as broker:
        publishing = Publishing(tmp_path, broker.port, broker, **({"user": "abbe"} | keys))
        if "ca" in keys:
            publishing.publisher._task["ca"] = None  # type: ignore[index]
        async with publishing.at_work():
            publishing.put(5)
            await until(lambda: publishing.said and publishing.publisher.connections >= 4)
            assert why in publishing.said[0][1]
            assert publishing.said[0][1].endswith("what is to be published waits")
            assert len(publishing.spool.oldest(10)) == 5
    # each reason is said once, however often it was tried
    assert len(set(publishing.said)) == len(publishing.said) <= 5


@pytest.mark.parametrize(
    "said",
    [
        b"",
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
        b"\x20\x03\x00\x00\x00" + b"\x30\xff\xff\xff\x7f" + bytes(1 << 20),
        b"\x20\x03\x00\x00\x00" + b"\x40\x02\x00\x01" * 1000,
        b"\xff" * 100_000,
        b"\x20\x03\x00\x97\x00",
    ],
    ids=["silence", "http", "huge", "acks of nothing", "ones", "quota"],
)
async def test_a_broker_that_never_answers_or_raves_costs_nothing_but_time(
    tmp_path: Path, said: bytes
) -> None:
    subscriber = Subscriber()
    with mosquitto(tmp_path) as broker:
        async with Gate(broker).standing() as gate:
            gate.silent, gate.said = not said, said
            publishing = Publishing(tmp_path, gate.port, broker, timeout=0.3)
            async with publishing.at_work():
                publishing.put(20)
                await until(lambda: gate.connections >= 3)
                assert len(publishing.spool.oldest(50)) == 20
                gate.silent, gate.said = False, b""
                gate.cut()
                async with subscriber.listening(broker, "+/+/events"):
                    await until(lambda: first_ids(subscriber)[-1:] == [20])
    assert first_ids(subscriber) == list(range(1, 21))


async def test_protocol_3(tmp_path: Path) -> None:
    subscriber = Subscriber()
    with mosquitto(tmp_path) as broker:
        async with subscriber.listening(broker):
            publishing = Publishing(tmp_path, broker.port, broker, version="3.1.1")
            async with publishing.at_work():
                publishing.put(3)
                await until(lambda: len(first_ids(subscriber)) == 3)
