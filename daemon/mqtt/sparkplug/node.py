"""An edge node: born, reborn when asked, its data in order; what waited comes as historical.

Sparkplug has data sent with quality of service 0, so that no broker acknowledges it. But a broker
answers a client in the order in which it was asked: after some messages comes a request that
changes nothing and has to be acknowledged, and only then are they taken for sent.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import aiomqtt

from abbe.daemon.mqtt.connection import BrokerConnection
from abbe.daemon.mqtt.messages import Message
from abbe.daemon.mqtt.sparkplug.metrics import (
    MetricReading,
    moment,
    no_event,
    of_device,
    of_event,
    of_node,
)
from abbe.daemon.mqtt.sparkplug.payload import (
    asks_for_rebirth,
    birth,
    data,
    node_birth,
    node_death,
)
from abbe.daemon.mqtt.spool import Spool, Waiting

NAMESPACE = "spBv1.0"
_AT_ONCE = 50
"""Messages that are sent before the broker is asked whether it has them."""
_LISTENED = 100
"""Commands and states that wait to be looked at; what is more is dropped."""
_NUMBERS = 256
"""Numbers of messages and of connections go round (specification, 6.4.5)."""
_NODE, _DEVICE = "NDATA", "DDATA"


class SparkplugNode(BrokerConnection):
    """One edge node with one device, the machine."""

    def __init__(
        self,
        task: Mapping[str, Any],
        spool: Spool,
        about: Mapping[str, Any],
        say: Callable[[int, str], None],
    ) -> None:
        super().__init__(task, spool, about, say)
        self._now: dict[str, dict[str, MetricReading]] = {_NODE: {}, _DEVICE: {}}
        self._known = asyncio.Event()
        self._aliases: dict[str, int] = {}
        self._reborn = True
        self._before = 0
        self._numbers = itertools.count()
        self._host_online = False
        self._host_since = -1
        self._host_news = asyncio.Event()
        self._puzzled = False

    def put_status(self, status: Mapping[str, Any], dropped: int) -> None:
        """Take a run's status: what has changed is data, a metric that is new asks for a birth."""
        at = moment(status["at"])
        events = {r.name: r for r in no_event(at)} | self._events()
        self._put(_NODE, [*of_node(status, self._spool.lost + dropped), *events.values()])
        self._put(_DEVICE, of_device(status))
        self._known.set()

    def put_event(self, event: Mapping[str, Any]) -> None:
        """Take one event of the journal."""
        readings = list(of_event(event, self._spool.last_id + 1))
        if self._now[_NODE]:
            self._now[_NODE] |= {reading.name: reading for reading in readings}
        self._wait_for_broker(_NODE, readings)

    def _events(self) -> dict[str, MetricReading]:
        return {n: r for n, r in self._now[_NODE].items() if n.startswith("Events/")}

    def _put(self, kind: str, readings: Iterable[MetricReading]) -> None:
        before = self._now[kind]
        now = self._now[kind] = {reading.name: reading for reading in readings}
        if now.keys() != before.keys():
            self._reborn = True
        news = [
            r
            for n, r in now.items()
            if (before[n].says != r.says if n in before else r.value is not None)
        ]
        if news:
            self._wait_for_broker(kind, news)

    def _wait_for_broker(self, kind: str, readings: Iterable[MetricReading]) -> None:
        self._spool.add(Message(kind, {"readings": [list(r) for r in readings]}, retain=False))
        self._news.set()

    async def _connected(self) -> None:
        """One connection: nothing is said before a birth, and no birth without its metrics."""
        while not self._known.is_set():
            if self._ending.is_set():
                return
            self._news.clear()
            await self._news.wait()
        number = self._spool.next_connection() % _NUMBERS
        will = aiomqtt.Will(
            self._topic("NDEATH"), node_death(number, _milliseconds()), qos=1, retain=False
        )
        async with self._client(will, _LISTENED) as client:
            self._note_refusals(client)
            self._host_online, self._host_since = self._task["primary_host"] is None, -1
            await client.subscribe(self._topic("NCMD"), qos=1)
            if self._task["primary_host"] is not None:
                await client.subscribe(self._state_topic, qos=1)
            async with asyncio.TaskGroup() as group:
                listening = group.create_task(self._listen(client))
                await self._send(client, number)
                listening.cancel()
            # the broker says nothing of a client that takes its leave
            death = node_death(number, _milliseconds())
            await client.publish(self._topic("NDEATH"), death, qos=1)

    @property
    def _state_topic(self) -> str:
        return f"{NAMESPACE}/STATE/{self._task['primary_host']}"

    async def _listen(self, client: aiomqtt.Client) -> None:
        """Two things are heard: that births are wanted, and whether the primary host is there."""
        async for message in client.messages:
            body = message.payload if isinstance(message.payload, bytes) else b""
            try:
                if str(message.topic) == self._state_topic:
                    self._hear_host(body)
                elif asks_for_rebirth(body):
                    self._reborn = True
                    self._news.set()
            except ValueError as error:
                if not self._puzzled:
                    self._say(logging.WARNING, f"{message.topic}: {error}; it is not heard")
                self._puzzled = True

    def _hear_host(self, body: bytes) -> None:
        try:
            said = json.loads(body[:1000])
            online, since = said["online"], said["timestamp"]
        except (ValueError, TypeError, KeyError, RecursionError):
            raise ValueError("a state that is none") from None
        if type(online) is not bool or type(since) is not int:
            raise ValueError("a state that is none")
        if since >= self._host_since:
            self._host_online, self._host_since = online, since
            self._news.set()

    async def _send(self, client: aiomqtt.Client, number: int) -> None:
        """Births and data, until the run is over or the primary host goes; then what is left."""
        born = False
        while not (self._ending.is_set() and (not born or not self._spool.oldest(1))):
            self._news.clear()
            if not self._host_online:
                if born:
                    self._lost("the primary host is offline")
                    return
                self._lost("the primary host is not online")
                await self._news.wait()
                continue
            if self._reborn or not born:
                await self._bear(client, number)
                if not born:
                    self._born()
                born = True
            waiting = self._spool.oldest(_AT_ONCE)
            for message in waiting:
                await self._send_one(client, message)
            if waiting:
                await self._broker_has_it(client)
                for message in waiting:
                    self._spool.done(message)
            elif not self._ending.is_set():
                await self._news.wait()

    async def _bear(self, client: aiomqtt.Client, number: int) -> None:
        """Births of node and device with all that is so now; what waits is of before."""
        self._reborn = False
        self._before = self._spool.last_id
        node, device = self._now[_NODE], self._now[_DEVICE]
        self._aliases = {name: i for i, name in enumerate([*node, *device], 1)}
        self._numbers = itertools.count(1)
        now = _milliseconds()
        said = node_birth(node.values(), self._aliases, number, now)
        await client.publish(self._topic("NBIRTH"), said, qos=0)
        said = birth(device.values(), self._aliases, self._next(), now)
        await client.publish(self._topic("DBIRTH"), said, qos=0)

    async def _send_one(self, client: aiomqtt.Client, message: Waiting) -> None:
        historical = message.series != self._spool.series or message.id <= self._before
        readings = [MetricReading(*given) for given in json.loads(message.body)["readings"]]
        known = [reading for reading in readings if reading.name in self._aliases]
        if known:
            said = data(known, self._aliases, self._next(), _milliseconds(), historical=historical)
            await client.publish(self._topic(message.topic), said, qos=0)

    async def _broker_has_it(self, client: aiomqtt.Client) -> None:
        """Return when the broker has taken all that was sent to it on this connection."""
        await client.unsubscribe(f"{self._topic('NCMD')}/none")

    def _next(self) -> int:
        return next(self._numbers) % _NUMBERS

    def _topic(self, kind: str) -> str:
        task = self._task
        node = f"{NAMESPACE}/{task['group']}/{kind}/{task['node']}"
        return f"{node}/{task['device']}" if kind.startswith("D") else node


def _milliseconds() -> int:
    return time.time_ns() // 1_000_000
