"""The MTConnect link: positions and temperatures that an agent publishes, all by one question."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Mapping, Sequence
from typing import ClassVar

from abbe.drivers import resources
from abbe.drivers.link import (
    ChannelInfo,
    LinkConfig,
    LinkError,
    LinkProtocolError,
    LinkState,
    Quality,
    Sample,
    WirePlace,
)
from abbe.drivers.mtconnect.config import MtconnectConfig
from abbe.drivers.mtconnect.follow import AgentFollower
from abbe.drivers.mtconnect.values import sample_of
from abbe.drivers.pace import Pace
from abbe.drivers.reading_link import ReadingLink, described
from abbe.drivers.reconnect import Reconnector

logger = logging.getLogger("abbe.drivers.mtconnect")

_NAN = math.nan


class MtconnectLink(ReadingLink):
    """One MTConnect agent and its channels; it only reads.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.
    """

    Config: ClassVar[type[LinkConfig]] = MtconnectConfig
    refusal: ClassVar[str] = "an MTConnect link only reads; see docs/mtconnect.md"

    def __init__(self, name: str, config: MtconnectConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._value_of = {key: channel.value_of for key, channel in config.channels.items()}
        self._follower = AgentFollower(name, config)
        self._pace = Pace(config.every)
        self._last: dict[str, Sample] = {}
        self._one_at_a_time = asyncio.Lock()
        self._waiting = 0
        self._reconnector = Reconnector(
            f"link {name} ({config.host}:{config.port})",
            config,
            self.status,
            self._connect,
            self._follower.drop,
            logger,
        )

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → which data item it is and what becomes of its number, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, and the time between two values; nothing is written."""
        section = self._config.channels[channel]
        return ChannelInfo(section.unit or "", writable=False, every=self._config.every)

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """Its data item in the agent."""
        section = self._config.channels[channel]
        place = f"{section.data} item {section.item or 1}"
        device = resources.tcp(self._config.host, self._config.port)
        return (WirePlace(device, space=(place,), apart=(True,)),)

    async def open(self) -> None:
        """Connect and see what is so now, or begin to retry."""
        await self._reconnector.open()

    async def close(self) -> None:
        """End the connection; a question in flight fails."""
        await self._reconnector.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read channels: all by one question, where one is due.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        self._check_known(channels, self._config.channels)
        now = time.monotonic()
        if self._pace.is_due(now):
            if self._waiting >= self._config.max_waiting:
                why = f"{self._waiting} calls wait for the agent already"
                return {name: Sample(_NAN, now, Quality.UNAVAILABLE, why) for name in channels}
            self._waiting += 1
            try:
                async with self._one_at_a_time:
                    await self._renew()
            finally:
                self._waiting -= 1
        return {name: self._last[name] for name in channels}

    async def _renew(self) -> None:
        """Ask what is new; whatever comes of it are the last samples."""
        if not self._reconnector.up:
            self._none(str(self._reconnector.down_error()))
            return
        self.status.requests += 1
        asked_at, epoch = time.monotonic(), self._reconnector.epoch
        try:
            await self._follower.renew()
        except LinkError as error:
            self.status.failures += 1
            answered = isinstance(error, LinkProtocolError)
            self._none(str(error), Quality.BAD if answered else Quality.UNAVAILABLE)
            # a connection that was followed by another says nothing of that
            if epoch == self._reconnector.epoch:
                self._reconnector.lost(str(error))
            return
        self.status.round_trip = time.monotonic() - asked_at
        self._take()
        if self._reconnector.up:
            why = self._why_not()
            self.status.become(LinkState.DEGRADED if why else LinkState.UP, why)

    def _why_not(self) -> str:
        return "the agent says of itself that it is tested" if self._follower.test else ""

    def _take(self) -> None:
        """All samples from what the agent said last."""
        follower, why = self._follower, self._why_not()
        for name, channel in self._config.channels.items():
            found = follower.last.get(channel.data)
            if why:
                sample = Sample(_NAN, follower.asked_at, Quality.BAD, why)
            elif found is None:
                lacks = f"{channel.data}: the agent has no observation of it"
                sample = Sample(_NAN, follower.asked_at, Quality.UNAVAILABLE, lacks)
            else:
                sample = sample_of(
                    channel,
                    self._value_of[name],
                    self._config.stamp,
                    found,
                    follower.asked_at,
                    follower.made_at,
                )
            self._last[name] = sample
        good = all(sample.good for sample in self._last.values())
        self._pace.asked(time.monotonic(), good=good)

    def _none(self, why: str, quality: Quality = Quality.UNAVAILABLE) -> None:
        now = time.monotonic()
        missing = Sample(_NAN, now, quality, why)
        self._last = dict.fromkeys(self._config.channels, missing)
        self._pace.asked(now, good=False)

    async def _connect(self) -> None:
        """What the agent has, checked, and a first answer."""
        self._follower.drop()
        await self._follower.begin()
        self._pace.clear()

    def _describe(self, name: str) -> str:
        channel = self._config.channels[name]
        return described(f"data item {channel.data}", channel.item, self._config.every, channel)
