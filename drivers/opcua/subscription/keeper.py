"""Keeps the subscription of one session: made, followed, and made anew when it is lost."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

from asyncua import ua

from abbe.drivers.link import LinkDownError, LinkError, LinkTimeoutError, Sample
from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.session import OpcuaSession
from abbe.drivers.opcua.subscription.clock import ServerClock, seconds
from abbe.drivers.opcua.subscription.lost import SubscriptionLostError
from abbe.drivers.opcua.subscription.notified import FIRST_CHANNEL, SERVER_CLOCK, NotifiedChannels
from abbe.drivers.opcua.subscription.services import (
    Monitored,
    Published,
    Subscribed,
    publish,
    subscribe,
    unsubscribe,
)

logger = logging.getLogger("abbe.drivers.opcua")

_SAMPLES = 2.0
"""Samples of a variable from one message to the next."""
_WAITED = 0.75
"""Part of the time between two messages after which the next Publish leaves.

Ages are counted from a Publish: the later it leaves, the less old seems what answers it."""
_AT_ONCE = 20
"""Messages in a row that may be fetched without a pause, when the server says that more wait."""
_OVERDUE = 3.0
"""Times between two messages after which the server is asked instead, until the next comes."""
_CLOCK_LOOKS = 1.0
"""s between two questions that hold the server's clock against ours."""
_CLOCK_STAMPS = 2
"""Questions that are asked before the first message: an offset that one stalled answer gave."""
_SLOWER = 1.5
"""Times the wanted time between two messages beyond which it is said that the server is slower."""
_FIRST_WAIT, _LAST_WAIT = 0.5, 30.0
"""s before a subscription is made anew: doubling."""
_STATE = ua.NodeId(ua.ObjectIds.Server_ServerStatus_State)
_TIME = ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime)


class Wanted(NamedTuple):
    """A channel that is to be subscribed to.

    Attributes
    ----------
    node
        Its variable, as the server numbers it now.
    value_of
        Its number → its value.
    every
        s between two values; 0: as often as there are messages.
    together
        Channels that are never read apart from it; may be empty.
    """

    node: ua.NodeId
    value_of: Callable[[float], float]
    every: float
    together: frozenset[str]


class SubscriptionKeeper:
    """The subscription of one session, for as long as this lasts.

    Parameters
    ----------
    label
        The link, for the log.
    session
        The session.
    config
        The link's section.
    wanted
        By channel.
    failed
        Told of each question that was not answered.

    Attributes
    ----------
    why
        Why there is no subscription now, so that the server is asked; empty: there is one.
    made
        Subscriptions that were made in this session.
    """

    def __init__(
        self,
        label: str,
        session: OpcuaSession,
        config: OpcuaConfig,
        wanted: Mapping[str, Wanted],
        failed: Callable[[LinkError], None],
    ) -> None:
        self._label, self._session, self._config = label, session, config
        self._wanted, self._failed = wanted, failed
        self._notified: NotifiedChannels | None = None
        self._usable: frozenset[str] = frozenset()
        self._clock = ServerClock()
        self._said: set[str] = set()
        self._task: asyncio.Task[None] | None = None
        self.why = "no message of the subscription yet"
        self.made = 0

    def start(self) -> None:
        """Begin, in a task of its own."""
        self._task = asyncio.create_task(self._keep(), name=f"{self._label} subscription")

    def stop(self) -> None:
        """Believe nothing more; safe to call at any time."""
        self._notified = None
        if self._task is not None:
            self._task.cancel()

    async def close(self) -> None:
        """Stop, and wait for the task's end."""
        self.stop()
        if self._task is not None:
            await asyncio.wait([self._task])

    def samples(self, now: float) -> Mapping[str, Sample]:
        """What the subscription says at `now` (monotonic, s): who is not in it is asked for."""
        notified = self._notified
        if notified is None or not notified.complete:
            return {}
        if now - notified.arrived_at > _OVERDUE * self._config.subscribe:
            return {}
        return {name: s for name, s in notified.samples.items() if name in self._usable}

    @property
    def state(self) -> str:
        """Why nothing of the server may be used, as it said of itself; empty: it runs."""
        return self._notified.state if self._notified is not None else ""

    async def _keep(self) -> None:
        """Have a subscription until the connection is lost."""
        wait = _FIRST_WAIT
        while True:
            began, granted = time.monotonic(), None
            try:
                granted, notified = await self._subscribe()
                await self._follow(granted, notified)
            except LinkDownError as error:
                self._lost(str(error))
                self._failed(error)
                return
            except LinkError as error:
                self._lost(str(error))
                if isinstance(error, LinkTimeoutError):
                    self._failed(error)
            except Exception as error:  # noqa: BLE001 - a stranger's messages, in a library's hands
                self._lost(f"{type(error).__name__}: {error}")
            if granted is not None:
                await unsubscribe(self._session, granted.number)
            if time.monotonic() - began > _LAST_WAIT:
                wait = _FIRST_WAIT
            await asyncio.sleep(wait)
            wait = min(2.0 * wait, _LAST_WAIT)

    async def _subscribe(self) -> tuple[Subscribed, NotifiedChannels]:
        config, names = self._config, tuple(self._wanted)
        self._clock = ServerClock()
        for _ in range(_CLOCK_STAMPS):
            await self._look_at_clock()
        pace = config.subscribe / _SAMPLES
        # whoever measures by source stamps is told of each new one
        stamped = config.stamp == "source"
        since = time.monotonic()
        granted = await subscribe(
            self._session,
            config.subscribe,
            [
                Monitored(_TIME, pace, stamped=False),
                Monitored(_STATE, pace, stamped=False),
                *(Monitored(w.node, w.every or pace, stamped) for w in self._wanted.values()),
            ],
        )
        if why := granted.refused.get(SERVER_CLOCK):
            await unsubscribe(self._session, granted.number)
            raise SubscriptionLostError(f"it does not notify of its own clock: {why}")
        taken = {
            handle: name
            for handle, name in enumerate(names, FIRST_CHANNEL)
            if handle in granted.sampling
        }
        if not taken:
            await unsubscribe(self._session, granted.number)
            raise SubscriptionLostError(
                next(iter(granted.refused.values()), "nothing to notify of")
            )
        self._usable = frozenset(
            name for name in taken.values() if self._wanted[name].together <= {*taken.values()}
        )
        notified = NotifiedChannels(
            config,
            taken,
            {name: w.value_of for name, w in self._wanted.items()},
            granted.sampling,
            granted.every,
            since,
        )
        self._notified = notified
        self.made += 1
        self._say_granted(names, granted)
        return granted, notified

    async def _follow(self, granted: Subscribed, notified: NotifiedChannels) -> None:
        """Take message after message until the subscription cannot be used any longer."""
        acknowledged: list[tuple[int, int]] = []
        looked_at, at_once, overflowed = time.monotonic(), 0, 0
        while True:
            if time.monotonic() - looked_at > _CLOCK_LOOKS:
                looked_at = time.monotonic()
                await self._look_at_clock()
            # one at a time: what answers it is known to have been made after it left
            message = await publish(
                self._session, acknowledged, granted.quiet + self._config.timeout
            )
            acknowledged = self._acknowledge(message)
            if message.subscription == granted.number and notified.take(message, self._clock):
                self._arrived(notified)
            if notified.overflowed > overflowed:
                overflowed = notified.overflowed
                self._say("values were lost in the server's queue; the newest one counts")
            at_once = at_once + 1 if message.more else 0
            if not 0 < at_once < _AT_ONCE:
                await asyncio.sleep(_WAITED * granted.every)

    @staticmethod
    def _acknowledge(message: Published) -> list[tuple[int, int]]:
        has_content = bool(message.changes or message.ended)
        return [(message.subscription, message.sequence)] if has_content else []

    def _arrived(self, notified: NotifiedChannels) -> None:
        if self.why and notified.complete:
            self.why = ""
            logger.info(
                "%s: the server notifies again" if self.made > 1 else "%s: the server notifies",
                self._label,
                extra={"event": "subscription made"},
            )

    async def _look_at_clock(self) -> None:
        answer = await self._session.read([_TIME])
        if answer.made_at is None:
            raise SubscriptionLostError("its answers do not say when they were made")
        self._clock.answered(answer.asked_at, time.monotonic(), seconds(answer.made_at))

    def _lost(self, why: str) -> None:
        """Take note that there is no subscription, and say so once."""
        self._notified = None
        if not self.why:
            self._said.discard(why)
        self.why = f"asked, not notified: {why}"
        said = {"event": "subscription lost"}
        self._say(f"no subscription, so the server is asked: {why}", said)

    def _say_granted(self, names: tuple[str, ...], granted: Subscribed) -> None:
        wanted = self._config.subscribe
        if granted.every > _SLOWER * wanted:
            self._say(f"the server notifies every {granted.every:g} s, {wanted:g} s was wanted")
        for handle, name in enumerate(names, FIRST_CHANNEL):
            if why := granted.refused.get(handle):
                self._say(f"channel {name} is asked for, the server does not notify of it: {why}")
            elif name not in self._usable:
                self._say(f"channel {name} is asked for, as those that it belongs with are")

    def _say(self, text: str, said: dict[str, str] | None = None) -> None:
        """Log something once in a session."""
        if text not in self._said:
            self._said.add(text)
            logger.warning("%s: %s", self._label, text, extra=said)
