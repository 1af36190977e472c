"""What the messages of a subscription say of its variables, each as old as it can be."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from datetime import datetime

from asyncua import ua

from abbe.compcore.units import in_digits
from abbe.drivers.link import Quality, Sample
from abbe.drivers.opcua.config import OpcuaConfig
from abbe.drivers.opcua.subscription.clock import ServerClock, seconds
from abbe.drivers.opcua.subscription.lost import SubscriptionLostError
from abbe.drivers.opcua.subscription.services import Published
from abbe.drivers.opcua.values import of_state, sample_of

SERVER_CLOCK, SERVER_STATE, FIRST_CHANNEL = 0, 1, 2
"""Handles: what every subscription monitors beside its channels, and where these begin."""
_JITTER = 0.1
"""s by which a message may be published later than it is answered: clocks are read in steps."""
_SLOWEST_CLOCK = 1.0
"""s between two samples of a server's own clock where it says less: servers renew it so."""
_MISSED = 3.0
"""Samples of its own clock that a server may miss before it is said to sample no longer."""
_GREATEST = 1 << 32
_OVERFLOWED = 0x480
"""Bits of a status code: values before this one were lost in the server's queue (Part 4, 7.39)."""
_CLOCK_NAME = "the server's own clock (Server_ServerStatus_CurrentTime)"


class NotifiedChannels:
    """The channels of one subscription, by what its messages say.

    A message answers a Publish, so that it was made after that had left: this, not when it came,
    is what ages are counted from, and the later of two bounds is never taken. A value that is not
    in a message has not changed at the last sample before it.

    Parameters
    ----------
    config
        The link's section.
    channels
        Handle → its channel, of those that are monitored.
    value_of
        Channel → its number → its value.
    sampling
        Handle → s between two samples.
    every
        s between two messages.
    since
        When the question left by which the subscription was made, monotonic, s.

    Attributes
    ----------
    samples
        Channel → its last sample; those of which nothing came yet are not in it.
    arrived_at
        When the last message in order came, monotonic, s.
    overflowed
        Values that came after others were lost in the server's queue.
    state
        Why nothing of the server may be used; empty when it says that it runs.
    """

    def __init__(
        self,
        config: OpcuaConfig,
        channels: Mapping[int, str],
        value_of: Mapping[str, Callable[[float], float]],
        sampling: Mapping[int, float],
        every: float,
        since: float,
    ) -> None:
        self._config, self._channels, self._value_of = config, channels, value_of
        self._sampling, self._every = sampling, every
        self._since = since
        self._first: int | None = None
        self._next: int | None = None
        self._sampled: float | None = None
        self._held: dict[str, Sample] = {}
        self.samples: Mapping[str, Sample] = {}
        self.arrived_at = -math.inf
        self.overflowed = 0
        self.state = ""

    @property
    def complete(self) -> bool:
        """Whether something came of every channel, and of the server's own clock."""
        return self._sampled is not None and len(self._held) == len(self._channels)

    def take(self, message: Published, clock: ServerClock) -> bool:
        """Take a message in; False when it is one that was taken before.

        Raises
        ------
        SubscriptionLostError
            When it does not follow the last one, or tells that the subscription is of no use.
        """
        if message.ended:
            raise SubscriptionLostError(message.ended)
        if message.made_at is None:
            raise SubscriptionLostError("its answers do not say when they were made")
        made_at = seconds(message.made_at)
        clock.answered(message.asked_at, message.arrived_at, made_at)
        if not self._follows(message):
            return False
        earliest = min(message.asked_at, clock.earliest(made_at))
        self._take_changes(message, earliest, self._published(message, earliest, made_at))
        self._check_sampled(made_at)
        self._check_begun(message)
        if not message.more:
            # nothing waited there: whatever the next one holds came after this one was made
            self._since = earliest
        self.arrived_at = message.arrived_at
        bad = Sample(math.nan, earliest, Quality.BAD, self.state)
        self.samples = dict.fromkeys(self._held, bad) if self.state else dict(self._held)
        return True

    def _follows(self, message: Published) -> bool:
        """Whether it is the next message; one that is missing may have told of any variable."""
        if self._first is None:
            self._first = message.sequence
        due = self._next if self._next is not None else message.sequence
        ahead = (message.sequence - due) % _GREATEST
        if ahead >= _GREATEST // 2:
            # some servers give a message without content the number of the one before
            return not message.changes and ahead == _GREATEST - 1
        if ahead:
            raise SubscriptionLostError(f"{ahead} of its messages did not come")
        self._next = due
        if message.changes:
            self._next = 1 if due == _GREATEST - 1 else due + 1
        return True

    def _published(self, message: Published, earliest: float, made_at: float) -> float:
        """The earliest moment at which a message can have been put together, monotonic, s.

        Some servers do not say it (node-opcua's messages carry no time): then it was after the one
        before, if nothing more waited at that.
        """
        if message.published_at is None:
            return min(earliest, self._since)
        waited = made_at - seconds(message.published_at)
        if waited < -_JITTER:
            raise SubscriptionLostError(
                f"a message was published {in_digits(-waited)} s later than it was answered"
            )
        return earliest - max(0.0, waited)

    def _take_changes(self, message: Published, earliest: float, published_at: float) -> None:
        """Take in what is new and, without stamps, that nothing else is.

        Parameters
        ----------
        message
            The message.
        earliest, published_at
            The earliest moments at which it can have been answered and first made, monotonic, s.
        """
        if self._config.stamp == "none":
            for handle, name in self._channels.items():
                sample = self._held.get(name)
                sampled = published_at - self._sampling[handle]
                if sample is not None and sample.time < sampled:
                    self._held[name] = sample._replace(time=sampled)
        for handle, found in message.changes:
            if handle == SERVER_STATE:
                self.state = of_state(found)
            elif handle == SERVER_CLOCK:
                self._sampled = _time_of(found, self._sampled)
            elif handle in self._channels:
                name, asked = self._channels[handle], earliest
                if self._config.stamp == "none":
                    asked = published_at - self._sampling[handle]
                self.overflowed += (
                    found.StatusCode is not None
                    and found.StatusCode.value & _OVERFLOWED == _OVERFLOWED
                )
                self._held[name] = sample_of(
                    self._config.channels[name],
                    self._value_of[name],
                    self._config.stamp,
                    found,
                    asked,
                    message.made_at,
                )
            else:
                raise SubscriptionLostError(f"a message tells of a variable {handle}: unknown")

    def _check_begun(self, message: Published) -> None:
        """See that the message came that says what everything was in the beginning.

        It is number 1 (Part 4, 5.14.1). Whatever does not change is told of in no other.
        """
        if self._first != 1 and not message.more and not self.complete:
            raise SubscriptionLostError("its first message did not come")

    def _check_sampled(self, made_at: float) -> None:
        """See that the server still samples: its own clock changes always."""
        if self._sampled is None:
            return
        pace = max(_SLOWEST_CLOCK, self._sampling[SERVER_CLOCK], self._every)
        silent = made_at - self._sampled
        if silent > _MISSED * pace:
            raise SubscriptionLostError(
                f"it has not sampled {_CLOCK_NAME} for {in_digits(silent)} s, though it publishes"
            )


def _time_of(found: ua.DataValue, last: float | None) -> float | None:
    value = found.Value.Value if found.Value is not None else None
    return seconds(value) if isinstance(value, datetime) else last
