"""Keeping a connection: opened, its loss noticed and logged once, found again with back-off.

A link that reconnects by itself gives a `Reconnector` two functions, one that connects and gets a
first answer and one that disconnects at once, and tells it when the connection was lost.
"""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Awaitable, Callable
from typing import Annotated

from pydantic import Field, model_validator

from abbe.drivers.link import (
    LinkConfig,
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkState,
    LinkStatus,
)


class ReconnectConfig(LinkConfig):
    """How a link looks for a connection that it lost."""

    reconnect_min: Annotated[float, Field(gt=0)] = 0.1
    """s before the first attempt to reconnect; doubles up to the next."""
    reconnect_max: Annotated[float, Field(gt=0)] = 2.0

    @model_validator(mode="after")
    def _backs_off(self) -> ReconnectConfig:
        if self.reconnect_max < self.reconnect_min:
            raise ValueError(
                f"reconnect_max {self.reconnect_max} is below reconnect_min {self.reconnect_min}"
            )
        return self


class Reconnector:
    """One connection, opened again with back-off whenever it is lost.

    Parameters
    ----------
    label
        The link, for the log and for reasons: ``link cmm (192.168.0.10:502)``.
    config
        Its back-off.
    status
        Kept up to date.
    connect
        Connects and gets a first answer: a device that accepts and says nothing is not up. Raises
        `LinkError` when there is none. What an earlier attempt left open it closes itself.
    disconnect
        Gives the connection up at once; safe to call at any time.
    logger
        Where a loss and a recovery are logged, one line each.
    on_up
        Called when the connection is up, after `status` says so.

    Attributes
    ----------
    up
        Whether the connection can be used.
    epoch
        Counts connections: what was learned on an earlier one need not hold.
    """

    def __init__(
        self,
        label: str,
        config: ReconnectConfig,
        status: LinkStatus,
        connect: Callable[[], Awaitable[None]],
        disconnect: Callable[[], None],
        logger: logging.Logger,
        on_up: Callable[[], None] = lambda: None,
    ) -> None:
        self.label = label
        self.status = status
        status.detail = "not opened"
        self.up = False
        self.epoch = 0
        self._config = config
        self._connect = connect
        self._disconnect = disconnect
        self._on_up = on_up
        self._logger = logger
        self._down = asyncio.Event()
        self._lost_at = 0.0
        self._up_at = 0.0
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Connect, or begin to retry in the background; a second call does nothing.

        Raises
        ------
        LinkConfigError
            When connecting shows that the configuration can never work.
        """
        if self._task is not None:
            return
        self.status.become(LinkState.CONNECTING, "opening")
        try:
            await self._attempt()
        except LinkConfigError:
            self._disconnect()
            self.status.become(LinkState.CLOSED, "closed")
            raise
        except LinkError as exc:
            self._begin_outage(str(exc))
        self._task = asyncio.create_task(self._keep(), name=f"{self.label} keeper")

    async def close(self) -> None:
        """Disconnect and end the background task; safe to call twice."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])
        self.up = False
        self._disconnect()
        self.status.become(LinkState.CLOSED, "closed")

    def lost(self, why: str) -> None:
        """Take note that the connection is gone; only the first of several calls counts."""
        if self.up:
            self._begin_outage(why)

    def down_error(self) -> LinkDownError:
        """Why the connection cannot be used, as the error to raise."""
        return LinkDownError(f"{self.label} is {self.status.state.value}: {self.status.detail}")

    def _begin_outage(self, why: str) -> None:
        self.up = False
        self._disconnect()
        self._lost_at = time.monotonic()
        self.status.become(LinkState.DOWN, why)
        self._logger.warning(
            "%s lost: %s; reconnecting", self.label, why, extra={"event": "link lost"}
        )
        self._down.set()

    async def _keep(self) -> None:
        """Reconnect whenever the connection was lost; the delay doubles, with jitter.

        The delay starts anew only after the connection has been up for a while, so that a device
        that takes connections and drops them again is not besieged.
        """
        config = self._config
        delay = config.reconnect_min
        while True:
            await self._down.wait()
            if self._lost_at - self._up_at > config.reconnect_max:
                delay = config.reconnect_min
            while not self.up:
                await asyncio.sleep(delay * random.uniform(0.5, 1.0))
                delay = min(2.0 * delay, config.reconnect_max)
                try:
                    await self._attempt()
                except Exception as exc:  # noqa: BLE001 - whatever it was, it must be found again
                    self._disconnect()
                    what = "" if isinstance(exc, LinkError) else f"{type(exc).__name__}: "
                    self.status.become(LinkState.DOWN, f"{what}{exc}")
            self.status.reconnects += 1
            lasted = self._up_at - self._lost_at
            said = {"event": "link back"}
            self._logger.info("%s back after %.1f s", self.label, lasted, extra=said)

    async def _attempt(self) -> None:
        await self._connect()
        # No await between the first answer and this: nothing can be lost unnoticed.
        self.up = True
        self._up_at = time.monotonic()
        self.epoch += 1
        self._down.clear()
        self.status.become(LinkState.UP)
        self._on_up()
