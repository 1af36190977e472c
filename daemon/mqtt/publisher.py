"""Plain JSON to the broker, in order and again until each message is acknowledged; for ever."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import aiomqtt

from abbe.daemon.mqtt.connection import BrokerConnection
from abbe.daemon.mqtt.messages import ONLINE, Message, of_event, of_status
from abbe.daemon.mqtt.spool import Waiting

_IN_FLIGHT = 10
"""Messages that are on their way at a time."""


class Publisher(BrokerConnection):
    """One broker that is told everything as JSON; nothing that it says is listened to."""

    def put(self, message: Message) -> None:
        """Take a message that is to be published."""
        self._spool.add(message)
        self._news.set()

    def put_status(self, status: Mapping[str, Any], dropped: int) -> None:
        """Take a run's status; with it goes how much of what was to be published is lost."""
        figures = {"lost": self._spool.lost + dropped, "refused": self.refused}
        for message in of_status(status):
            body = message.body
            if message.topic == "health":
                body = {**body, "mqtt": figures}
            self.put(message._replace(body=body))

    def put_event(self, event: Mapping[str, Any]) -> None:
        """Take one event of the journal."""
        self.put(of_event(event))

    async def _connected(self) -> None:
        """One connection, from birth to its end."""
        # the number of the attempt names a death's birth
        number = self.connections + 1
        will = aiomqtt.Will(
            self._topic(ONLINE), self._life(number, online=False), qos=1, retain=True
        )
        # whatever a broker sends unasked is dropped
        async with self._client(will, 1) as client:
            self._note_refusals(client)
            await self._publish(client, ONLINE, self._life(number, online=True), retain=True)
            self._born()
            async with asyncio.TaskGroup() as group:
                watching = group.create_task(_watch(client))
                await self._send(client)
                watching.cancel()
            await self._publish(client, ONLINE, self._life(number, online=False), retain=True)

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

    def _life(self, connection: int, *, online: bool) -> bytes:
        """Birth or death; a death belongs to the birth of the same connection."""
        body = {
            "online": online,
            "series": self._spool.series,
            "connection": connection,
            "since": datetime.now(UTC).isoformat(timespec="milliseconds"),
            **self._about,
        }
        return json.dumps(body).encode("ascii")


async def _watch(client: aiomqtt.Client) -> None:
    """Drop what the broker says; raise when the connection is lost."""
    async for _ in client.messages:
        pass
