"""The link contract: what every connection to a device must do, and how links are found.

A link is one physical bus (a TCP connection, a serial port, a CAN interface) with one owner.
It turns named channels of its configuration into `Sample` objects and back. A link plugin is
one class registered under the entry-point group ``abbe.links``; ``CONTRIBUTING.md`` shows
one in a page.

Errors form one tree::

    LinkError                      anything a link says
    ├── LinkConfigError            the configuration cannot work; raised before anything opens
    ├── LinkDownError              no connection (also a ConnectionError)
    ├── LinkTimeoutError           the device did not answer in time (also a TimeoutError)
    ├── LinkProtocolError          the device answered, and the answer is wrong or foreign
    ├── TooLateError               the time in which it may be sent was over before it was sent
    └── WriteNotVerifiedError      read-back after a write differs from what was written
"""

from __future__ import annotations

import enum
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import repeat
from typing import ClassVar, NamedTuple, Self

from pydantic import BaseModel, ConfigDict

from abbe.compcore.errors import InputError
from abbe.compcore.plugins import PluginGroup

LINK_GROUP = "abbe.links"


class LinkError(Exception):
    """Root of all link errors; the message says what, which device, and how to mend it.

    Attributes
    ----------
    untouched
        After a failed `Link.write`: channels that certainly hold what they held before, because
        nothing was sent for them, or because the device said that it does not take it.
    written
        After a failed `Link.write`: channels that the device certainly took. What is in neither
        set was sent, and nobody knows whether it was taken.
    """

    untouched: frozenset[str] = frozenset()
    written: frozenset[str] = frozenset()

    def leaving(self, untouched: Iterable[str] = (), written: Iterable[str] = ()) -> Self:
        """The same error, with what became of the channels of a write."""
        self.untouched, self.written = frozenset(untouched), frozenset(written)
        return self


class LinkConfigError(LinkError, ValueError):
    """The configuration cannot work, e.g. two channels overlap with different types.

    Attributes
    ----------
    field
        Keys below the link's section that lead to what is wrong, e.g. ``("channels", "x")``;
        empty: the section itself.
    """

    def __init__(self, message: str, field: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.field = tuple(field)


class LinkDownError(LinkError, ConnectionError):
    """There is no connection, e.g. the server was stopped or the cable pulled."""


class LinkTimeoutError(LinkError, TimeoutError):
    """The device did not answer in time, e.g. a unit on a shared bus is switched off."""


class LinkProtocolError(LinkError):
    """The device answered, and the answer is wrong or belongs to another request."""


class TooLateError(LinkError):
    """What was to be written had become too old before it could be sent; it was not sent."""


class WriteNotVerifiedError(LinkError):
    """The read-back after a write differs from what was written."""


class Quality(enum.Enum):
    """Whether a sample may be used. Zero is a value; "unavailable" is a quality."""

    GOOD = "good"
    BAD = "bad"
    """The device answered, but not with this value (exception, illegal content)."""
    UNAVAILABLE = "unavailable"
    """No answer: link down, time-out, unit quarantined."""


class Sample(NamedTuple):
    """One reading of one channel. A tuple, because a live cycle makes some dozens of them.

    Attributes
    ----------
    value
        The channel's number in the unit that its configuration names; NaN when not `good`.
    time
        `time.monotonic()` in s: the earliest moment at which the device can have taken the value.
        That is when the question left (or the device's own stamp, or the SYNC that it answers),
        never when the answer arrived: a late answer is an old one. Of a bad sample, the attempt.
    quality
        Whether `value` may be used.
    reason
        For people: empty when good, else what went wrong.
    """

    value: float
    time: float
    quality: Quality = Quality.GOOD
    reason: str = ""

    @property
    def good(self) -> bool:
        """Whether the value may be used."""
        return self.quality is Quality.GOOD

    def age(self, now: float | None = None) -> float:
        """Seconds since the earliest moment at which it can have been taken, monotonic clock."""
        return (time.monotonic() if now is None else now) - self.time


def good_samples(values: Iterable[float], at: float) -> Iterator[Sample]:
    """Good samples of one moment (monotonic, s): as `Sample`, in a third of the time."""
    return map(_sample, zip(values, repeat(at), _ALL_GOOD, _NO_REASON, strict=False))


_sample: Callable[[tuple[float, float, Quality, str]], Sample] = partial(tuple.__new__, Sample)
_ALL_GOOD, _NO_REASON = repeat(Quality.GOOD), repeat("")


@dataclass(frozen=True, slots=True)
class ChannelInfo:
    """What the configuration says of one channel, for checks before anything opens and for people.

    Attributes
    ----------
    unit
        Unit of the channel's values; empty when the configuration does not name it.
    writable
        Whether `Link.write` takes it.
    every
        s between two reads of the device; 0: at every call of `Link.read`.
    low, high
        Smallest and largest value that the channel's type can carry, in its unit.
    step
        What the value of the channel's type is a multiple of, in its unit; 0: no such step.
    read_back
        Whether what is written can be read again with `Link.read`.
    """

    unit: str = ""
    writable: bool = False
    every: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    step: float = 0.0
    read_back: bool = False


@dataclass(frozen=True, slots=True)
class WirePlace:
    """Where a channel sits on the wire, comparable between links to one device.

    Attributes
    ----------
    device
        Who is asked, spelled alike by all links to it: ``tcp 192.168.0.10:502``.
    first, end
        Addresses from `first` up to, not including, `end`.
    space
        Which of the device's address spaces, part by part: ``("unit 1", "holding")``.
    apart
        For each part of `space`: whether those that differ in it are known not to be the same
        memory. Many devices answer with one memory for all units, or for holding and input
        registers, so it takes the user's word.
    """

    device: str
    first: int = 0
    end: int = 1
    space: tuple[str, ...] = ()
    apart: tuple[bool, ...] = ()

    def overlaps(self, other: WirePlace) -> bool:
        """Whether a device may keep the two in the same memory."""
        if self.device != other.device or self.end <= other.first or other.end <= self.first:
            return False
        both = zip(self.space, other.space, self.apart, other.apart, strict=False)
        return not any(mine != its and one and two for mine, its, one, two in both)


class LinkState(enum.Enum):
    """What a link is doing, for the live screen and the status register."""

    CLOSED = "closed"
    CONNECTING = "connecting"
    UP = "up"
    DEGRADED = "degraded"
    """Connected, but at least one unit or block does not answer."""
    DOWN = "down"
    """Lost; reconnecting with back-off."""


@dataclass(slots=True)
class LinkStatus:
    """A link's visible health; kept up to date by the link, read by anybody.

    Times are in s; `round_trip` is that of the last request answered.
    """

    state: LinkState = LinkState.CLOSED
    since: float = field(default_factory=time.monotonic)
    detail: str = ""
    round_trip: float = float("nan")
    requests: int = 0
    failures: int = 0
    reconnects: int = 0
    quarantined: dict[str, str] = field(default_factory=dict)
    """Unit → why it is left alone for now."""

    def become(self, state: LinkState, detail: str = "") -> bool:
        """Enter a state; True when it is a change (so that it is logged once)."""
        changed = state is not self.state
        if changed:
            self.state = state
            self.since = time.monotonic()
        self.detail = detail
        return changed


class LinkConfig(BaseModel):
    """Base of every link's configuration section; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Link(ABC):
    """One owner of one physical bus.

    A link never blocks the event loop (for longer than `abbe.drivers.reply_wait` says), bounds
    every wait,
    reconnects by itself, and hands back a `Sample` for every channel asked for: an outage shows as
    quality, not as an exception.
    """

    Config: ClassVar[type[LinkConfig]]
    """The pydantic class that checks this link's section of the configuration."""

    status: LinkStatus

    def __init__(self, name: str, config: LinkConfig) -> None:
        self.name = name
        self.config = config
        self.status = LinkStatus()

    @property
    @abstractmethod
    def channels(self) -> Mapping[str, str]:
        """Channel name → one line for people: where it sits and how it is decoded."""

    def _check_known(self, names: Iterable[str], known: Collection[str]) -> None:
        """Refuse names that are none of the configuration's channels.

        Raises
        ------
        LinkConfigError
            Naming them, and those that there are.
        """
        unknown = [name for name in names if name not in known]
        if unknown:
            raise LinkConfigError(
                f"link {self.name} has no channel {', '.join(map(repr, unknown))}; "
                f"there are: {', '.join(known)}"
            )

    def info(self, channel: str) -> ChannelInfo:
        """What the configuration says of one of `channels`; a link that knows more overrides it."""
        return ChannelInfo(writable=channel in self.channels)

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """Where one of `channels` sits, for finding that two are the same; empty: unknown."""
        return ()

    @property
    def owns(self) -> tuple[str, ...]:
        """What only one process may use at a time, e.g. ``tcp 192.168.0.10:502``; may be empty."""
        return ()

    def owns_for(self, channels: Collection[str]) -> tuple[str, ...]:
        """The part of `owns` that only one process may use when it writes these channels."""
        return self.owns

    def goes_with(self, channel: str) -> frozenset[str]:
        """Writable channels that always go out in one message with `channel`, itself included."""
        return frozenset((channel,))

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """Take note that these channels must be of one moment: never read them apart.

        Called before `open`. When the device refuses the request that holds them all, all of them
        are bad.

        Parameters
        ----------
        channels
            Names.
        one_sample
            Whether they must also be answers to one question, as positions and the sample number
            that they are returned with.

        Raises
        ------
        LinkConfigError
            When they can never be of one moment, although `one_sample` asks for it.
        """
        return

    @abstractmethod
    async def open(self) -> None:
        """Start the link; return once it is up or retrying in the background.

        Raises
        ------
        LinkConfigError
            When the configuration can never work. An unreachable device is not an error here.
        """

    @abstractmethod
    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read a batch of channels in as few requests as possible.

        Every channel asked for is in the answer; what could not be read has a bad quality.
        """

    @abstractmethod
    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        """Write channels; returns when the device acknowledged (and verified, where configured).

        Parameters
        ----------
        values
            By channel, in its unit.
        until
            `time.monotonic()` in s from which on nothing may leave any more: what waits for its
            turn, or for a connection, for so long is given up. Checked before every message.

        Raises
        ------
        LinkError
            When any value was not written; the message says which, `LinkError.untouched` and
            `LinkError.written` say what became of each.
        """

    @abstractmethod
    async def close(self) -> None:
        """End the link and all its tasks; safe to call twice."""


PLUGINS: PluginGroup[Link] = PluginGroup(LINK_GROUP, Link, "link driver")


def link_class(driver: str) -> type[Link]:
    """Load a link plugin by its name.

    Raises
    ------
    LinkConfigError
        When there is none of that name, or it is not a `Link`; lists those that exist.
    """
    try:
        return PLUGINS.get(driver)
    except InputError as error:
        raise LinkConfigError(str(error)) from None
