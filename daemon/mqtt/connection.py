"""One broker: connected to, lost, and connected to again, for ever; what that is needed for."""

from __future__ import annotations

import asyncio
import logging
import random
import ssl
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import aiomqtt

from abbe.daemon.mqtt.spool import Spool
from abbe.daemon.side_process.secret import password

_KEEPALIVE = 30
"""s without a word after which the broker is asked whether it is there."""
_REASONS = 5
"""Reasons why there is no connection that are said, until there is one again."""
_VERSIONS = {"5": aiomqtt.ProtocolVersion.V5, "3.1.1": aiomqtt.ProtocolVersion.V311}

# paho and aiomqtt log every lost connection; here an outage is said once
_silent = logging.getLogger("abbe.mqtt.library")
_silent.setLevel(logging.CRITICAL + 1)


class BrokerConnection(ABC):
    """Publishes to one broker what a run says; what is said how is each format's own.

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

    @abstractmethod
    def put_status(self, status: Mapping[str, Any], dropped: int) -> None:
        """Take a run's status, as its JSON gives it, and how many messages never came here."""

    @abstractmethod
    def put_event(self, event: Mapping[str, Any]) -> None:
        """Take one event of the journal: ``at``, ``level``, ``part``, ``text``."""

    @abstractmethod
    async def _connected(self) -> None:
        """One connection, from birth to its end."""

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
                await within(self._ending.wait(), delay * random.uniform(0.5, 1.0))

    def _client(self, will: aiomqtt.Will, waiting: int) -> aiomqtt.Client:
        """A client, not yet connected.

        Parameters
        ----------
        will
            What the broker says when the connection is lost.
        waiting
            Messages of the broker's that may wait to be looked at; what is more is dropped.
        """
        task = self._task
        self.connections += 1
        return aiomqtt.Client(
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
            will=will,
            max_queued_incoming_messages=waiting,
            logger=_silent,
        )

    def _born(self) -> None:
        """Say that there is a connection."""
        self._say(logging.INFO, f"connected to {self._task['host']}:{self._task['port']}")
        self._said.clear()

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


def _tls(task: Mapping[str, Any]) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=task.get("ca"))
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if "certificate" in task:
        context.load_cert_chain(task["certificate"], task["key"])
    return context


async def within(what: Any, seconds: float) -> None:
    """Await something for so many seconds at most."""
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
