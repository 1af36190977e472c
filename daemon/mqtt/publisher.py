"""Sends what waits to the broker, in order and again until it is acknowledged; for ever."""

from __future__ import annotations

import asyncio
import json
import logging
import random
import ssl
import stat
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import aiomqtt

from abbe.daemon.mqtt.messages import ONLINE, Message
from abbe.daemon.mqtt.spool import Spool, Waiting

_IN_FLIGHT = 10
"""Messages that are on their way at a time."""
_KEEPALIVE = 30
"""s without a word after which the broker is asked whether it is there."""
_REASONS = 5
"""Reasons why there is no connection that are said, until there is one again."""
_VERSIONS = {"5": aiomqtt.ProtocolVersion.V5, "3.1.1": aiomqtt.ProtocolVersion.V311}

# paho and aiomqtt log every lost connection; here an outage is said once
_silent = logging.getLogger("abbe.mqtt.library")
_silent.setLevel(logging.CRITICAL + 1)


class Publisher:
    """One broker.

    Parameters
    ----------
    task
        As `MqttSetup.task` makes it.
    spool
        What waits.
    about
        What birth says of the run.
    say
        Takes a level and a sentence for the journal.

    Attributes
    ----------
    connections
        Attempts to connect.
    refused
        Messages that the broker acknowledged and said that it does not take (protocol 5 only).
    """

    def __init__(
        self,
        task: Mapping[str, Any],
        spool: Spool,
        about: Mapping[str, Any],
        say: Callable[[int, str], None],
    ) -> None:
        self._task, self._spool, self._about, self._say = task, spool, about, say
        self._news = asyncio.Event()
        self._ending = asyncio.Event()
        self._said: set[str] = set()
        self.connections = 0
        self.refused = 0

    def put(self, message: Message) -> None:
        """Take a message that is to be published."""
        self._spool.add(message)
        self._news.set()

    def end(self) -> None:
        """Have `run` send what it can at once, say that the run is over, and return."""
        self._ending.set()
        self._news.set()

    async def run(self) -> None:
        """Publish until `end`; whatever the broker does, nothing but that ends it."""
        delay = 0.0
        while not self._ending.is_set():
            began = time.monotonic()
            try:
                await self._connected()
            except* (aiomqtt.MqttError, OSError, ValueError) as errors:
                self._lost(_why(errors))
            if time.monotonic() - began > self._task["reconnect_max"]:
                delay = 0.0
            delay = min(2.0 * delay or self._task["reconnect_min"], self._task["reconnect_max"])
            if not self._ending.is_set():
                await _within(self._ending.wait(), delay * random.uniform(0.5, 1.0))

    async def _connected(self) -> None:
        """One connection, from birth to its end."""
        task = self._task
        self.connections += 1
        async with aiomqtt.Client(
            task["host"],
            task["port"],
            identifier=task["client_id"],
            protocol=_VERSIONS[task["version"]],
            username=task["user"],
            password=None if task["user"] is None else password(Path(task["password_file"])),
            tls_context=_tls(task) if task["tls"] else None,
            timeout=task["timeout"],
            keepalive=_KEEPALIVE,
            clean_session=True if task["version"] != "5" else None,
            will=aiomqtt.Will(self._topic(ONLINE), self._life(online=False), qos=1, retain=True),
            # whatever a broker sends unasked is dropped
            max_queued_incoming_messages=1,
            logger=_silent,
        ) as client:
            self._note_refusals(client)
            await self._publish(client, ONLINE, self._life(online=True), retain=True)
            self._say(logging.INFO, f"connected to {task['host']}:{task['port']}")
            self._said.clear()
            async with asyncio.TaskGroup() as group:
                watching = group.create_task(_watch(client))
                await self._send(client)
                watching.cancel()
            await self._publish(client, ONLINE, self._life(online=False), retain=True)

    async def _send(self, client: aiomqtt.Client) -> None:
        """Send what waits, as long as the connection is there and the run not over."""
        while True:
            self._news.clear()
            waiting = self._spool.oldest(_IN_FLIGHT)
            # each leaves in its turn; what is acknowledged is forgotten at once
            async with asyncio.TaskGroup() as group:
                for message in waiting:
                    group.create_task(self._send_one(client, message))
            if not waiting:
                if self._ending.is_set():
                    return
                await self._news.wait()

    async def _send_one(self, client: aiomqtt.Client, message: Waiting) -> None:
        await self._publish(client, message.topic, message.body, retain=message.retain)
        self._spool.done(message)

    async def _publish(
        self, client: aiomqtt.Client, topic: str, body: bytes, *, retain: bool
    ) -> None:
        """Publish, and return when the broker has it."""
        await client.publish(self._topic(topic), body, qos=1, retain=retain)

    def _topic(self, last: str) -> str:
        return f"{self._task['topic']}/{last}"

    def _life(self, *, online: bool) -> bytes:
        """Birth or death; a death belongs to the birth of the same connection."""
        body = {
            "online": online,
            "series": self._spool.series,
            "connection": self.connections,
            "since": datetime.now(UTC).isoformat(timespec="milliseconds"),
            **self._about,
        }
        return json.dumps(body).encode("ascii")

    def _note_refusals(self, client: aiomqtt.Client) -> None:
        """See what the broker says of each message: aiomqtt takes any answer for a good one."""
        paho = client._client
        acknowledged = paho.on_publish

        def look(its: Any, data: Any, number: int, reason: Any, properties: Any) -> None:
            if getattr(reason, "is_failure", False):
                self.refused += 1
                if self.refused == 1:
                    said = f"the broker does not take what is published: {reason}"
                    self._say(logging.WARNING, said)
            acknowledged(its, data, number, reason, properties)

        paho.on_publish = look

    def _lost(self, why: str) -> None:
        """Say what is wrong, once until it is right: two reasons may come in turn for days."""
        if why not in self._said and len(self._said) < _REASONS and not self._ending.is_set():
            self._said.add(why)
            self._say(logging.WARNING, f"{why}; what is to be published waits")


def password(path: Path) -> str:
    """The first line of a file that nobody else may read.

    Raises
    ------
    ValueError
        When others may read it, or it is no text.
    OSError
        When it cannot be read.
    """
    with path.open("rb") as file:
        if stat.S_IMODE(path.stat().st_mode) & 0o077:
            raise ValueError(f"{path}: others may read this password; chmod 600 {path}")
        line = file.readline(4096)
    return line.decode("utf-8").rstrip("\r\n")


def _tls(task: Mapping[str, Any]) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=task.get("ca"))
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if "certificate" in task:
        context.load_cert_chain(task["certificate"], task["key"])
    return context


async def _watch(client: aiomqtt.Client) -> None:
    """Drop what the broker says; raise when the connection is lost."""
    async for _ in client.messages:
        pass


async def _within(what: Any, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            await what
    except TimeoutError:
        return


def _why(errors: BaseException) -> str:
    """The first of some errors, in one line."""
    while isinstance(errors, BaseExceptionGroup):
        errors = errors.exceptions[0]
    if isinstance(errors, OSError) and errors.strerror:
        return errors.strerror
    return " ".join(f"{errors or type(errors).__name__}".split())[:300]
