"""The OPC UA link: positions and temperatures that a control offers, asked for or notified of."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

from asyncua import ua

from abbe.drivers import resources
from abbe.drivers.link import (
    ChannelInfo,
    LinkConfig,
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkState,
    LinkTimeoutError,
    Quality,
    Sample,
    WirePlace,
)
from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.session import OpcuaSession
from abbe.drivers.opcua.stated_units import check_units
from abbe.drivers.opcua.subscription.keeper import SubscriptionKeeper, Wanted
from abbe.drivers.opcua.values import of_state, sample_of
from abbe.drivers.pace import Pace
from abbe.drivers.reading_link import ReadingLink, described
from abbe.drivers.reconnect import Reconnector

logger = logging.getLogger("abbe.drivers.opcua")

_NAN = math.nan
_STATE = ua.NodeId(ua.ObjectIds.Server_ServerStatus_State)


class OpcuaLink(ReadingLink):
    """One OPC UA server and its channels; it only reads.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.
    """

    Config: ClassVar[type[LinkConfig]] = OpcuaConfig
    refusal: ClassVar[str] = "an OPC UA link only reads; see docs/opcua.md"

    def __init__(self, name: str, config: OpcuaConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._session: OpcuaSession | None = None
        self._keeper: SubscriptionKeeper | None = None
        self._nodes: dict[str, ua.NodeId] = {}
        self._value_of = {key: channel.value_of for key, channel in config.channels.items()}
        self._pace = {key: Pace(channel.every) for key, channel in config.channels.items()}
        self._last: dict[str, Sample] = {}
        self._together: dict[str, frozenset[str]] = {}
        self._waiting = 0
        self._silent = 0
        self._reconnector = Reconnector(
            f"link {name} ({config.host}:{config.port})",
            config,
            self.status,
            self._connect,
            self._drop,
            logger,
        )

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → which node it is and what becomes of its number, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, and the time between two values; nothing is written."""
        section = self._config.channels[channel]
        every = max(section.every, self._config.subscribe)
        return ChannelInfo(section.unit or "", writable=False, every=every)

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """Its node in the server."""
        section = self._config.channels[channel]
        place = f"{section.node} item {section.item or 1}"
        return (WirePlace(self._device, space=(place,), apart=(True,)),)

    @property
    def _device(self) -> str:
        return resources.tcp(self._config.host, self._config.port)

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """Channels of one pace are always read by one request.

        Raises
        ------
        LinkConfigError
            When `one_sample` is asked for and they are not of one pace, or subscribed to.
        """
        self._check_known(channels, self._config.channels)
        if one_sample and self._config.subscribe:
            raise LinkConfigError(
                f"link {self.name}: {', '.join(channels)} must be of one answer, and what a server "
                "notifies of is not: leave subscribe away"
            )
        paces = {self._config.channels[name].every for name in channels}
        if one_sample and len(paces) > 1:
            raise LinkConfigError(
                f"link {self.name}: {', '.join(channels)} must be of one answer: give them the "
                "same every"
            )
        for pace in paces:
            group = frozenset(n for n in channels if self._config.channels[n].every == pace)
            # who belongs to two groups belongs with all of both
            group = group.union(*(self._together.get(name, ()) for name in group))
            self._together |= dict.fromkeys(group, group)

    async def open(self) -> None:
        """Begin a session and get a first answer, or begin to retry."""
        await self._reconnector.open()

    async def close(self) -> None:
        """End the session and the connection; a question in flight fails."""
        await self._give_up()
        await self._reconnector.close()

    async def _give_up(self) -> None:
        keeper, self._keeper = self._keeper, None
        session, self._session = self._session, None
        if keeper is not None:
            await keeper.close()
        if session is not None:
            await session.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read channels: those that the server does not notify of, and are due, by one request.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        self._check_known(channels, self._config.channels)
        now = time.monotonic()
        keeper = self._keeper if self._reconnector.up else None
        notified = keeper.samples(now) if keeper is not None else {}
        due = [name for name in channels if name not in notified and self._pace[name].is_due(now)]
        if keeper is not None and notified:
            self._become(keeper.state)
        # what is of one moment is never read apart
        wanted = dict.fromkeys(due)
        for name in due:
            wanted |= dict.fromkeys(sorted(self._together.get(name, ())))
        if wanted:
            await self._renew(tuple(wanted))
        missing = Sample(_NAN, now, Quality.UNAVAILABLE, "not answered yet")
        return {name: notified.get(name) or self._last.get(name, missing) for name in channels}

    async def _renew(self, names: Sequence[str]) -> None:
        """Ask for channels; whatever comes of it is their last sample."""
        now, session = time.monotonic(), self._session
        if session is None or not self._reconnector.up:
            self._none(names, now, str(self._reconnector.down_error()))
            return
        if self._waiting >= self._config.max_waiting:
            why = f"{self._waiting} calls wait for the server already"
            self._none(names, now, why)
            return
        self._waiting += 1
        self.status.requests += 1
        try:
            answer = await session.read([_STATE, *(self._nodes[name] for name in names)])
        except LinkError as error:
            self.status.failures += 1
            self._failed(session, names, now, error)
            return
        finally:
            self._waiting -= 1
        self._silent = 0
        self.status.round_trip = time.monotonic() - answer.asked_at
        state, *values = answer.values
        why = of_state(state)
        for name, value in zip(names, values, strict=True):
            sample = sample_of(
                self._config.channels[name],
                self._value_of[name],
                self._config.stamp,
                value,
                answer.asked_at,
                answer.made_at,
            )
            if why:
                sample = Sample(_NAN, answer.asked_at, Quality.BAD, why)
            self._keep(name, sample)
        if self._reconnector.up and session is self._session:
            self._become(why)

    def _become(self, why: str) -> None:
        """Say how the link is: why nothing of the server is used, else why it is asked."""
        detail = why or (self._keeper.why if self._keeper is not None else "")
        self.status.become(LinkState.DEGRADED if why else LinkState.UP, detail)

    def _failed(
        self, session: OpcuaSession, names: Sequence[str], asked_at: float, error: LinkError
    ) -> None:
        """No answer, or a refusal of the whole question."""
        silent = isinstance(error, LinkTimeoutError)
        quality = Quality.UNAVAILABLE
        if not silent and not isinstance(error, LinkDownError):
            quality = Quality.BAD
        for name in names:
            self._keep(name, Sample(_NAN, asked_at, quality, str(error)))
        self._silent = self._silent + 1 if silent else 0
        # a session that was followed by another says nothing of that
        if session is self._session and (
            isinstance(error, LinkDownError) or self._silent >= self._config.unanswered
        ):
            self._reconnector.lost(str(error))

    def _none(self, names: Sequence[str], now: float, why: str) -> None:
        for name in names:
            self._keep(name, Sample(_NAN, now, Quality.UNAVAILABLE, why))

    def _keep(self, name: str, sample: Sample) -> None:
        last = self._last.get(name)
        # two callers: the answer to the later question stays
        if last is None or not last.good or not sample.good or sample.time >= last.time:
            self._last[name] = sample
        self._pace[name].asked(time.monotonic(), good=sample.good)

    async def _connect(self) -> None:
        """A new session, its namespaces, units, and a first answer."""
        await self._give_up()
        session = OpcuaSession(self._config)
        try:
            namespaces = await session.open()
            self._nodes = self._numbered(namespaces)
            if self._config.units:
                await check_units(self.name, self._config, session, self._nodes)
        except BaseException:
            # whatever was opened belongs to nobody
            session.drop()
            await session.close()
            raise
        self._session = session
        self._silent = 0
        self._last.clear()
        for pace in self._pace.values():
            pace.clear()
        if self._config.subscribe:
            self._keeper = self._subscription(session)
            self._keeper.start()

    def _subscription(self, session: OpcuaSession) -> SubscriptionKeeper:
        return SubscriptionKeeper(
            self._reconnector.label,
            session,
            self._config,
            {
                name: Wanted(
                    self._nodes[name],
                    self._value_of[name],
                    channel.every,
                    self._together.get(name, frozenset()),
                )
                for name, channel in self._config.channels.items()
            },
            lambda error: self._failed(session, (), time.monotonic(), error),
        )

    def _drop(self) -> None:
        if self._keeper is not None:
            self._keeper.stop()
        if self._session is not None:
            self._session.drop()

    def _numbered(self, namespaces: list[str]) -> dict[str, ua.NodeId]:
        """Channel → node id as this server numbers its namespaces now."""
        found = {}
        for name, channel in self._config.channels.items():
            try:
                found[name] = ua.NodeId.from_string(channel.name.numbered(namespaces))
            except (ValueError, ua.UaError) as error:
                raise LinkDownError(f"channel {name}: {channel.node}: {error}") from None
        return found

    def _describe(self, name: str) -> str:
        channel = self._config.channels[name]
        return described(f"node {channel.node}", channel.item, channel.every, channel)
