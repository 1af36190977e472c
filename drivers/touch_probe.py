"""What a link offers that lets a machine touch something by itself; the contract of its class.

Whoever uses it moves a machine. Places are those of the middle of the stylus's tip in machine
coordinates, mm; directions are unit vectors away from the surface.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from abbe.drivers.link import Link, LinkError

Place = tuple[float, float, float]


class NotTouchedError(LinkError):
    """The stylus came to the end of its search and touched nothing."""


@dataclass(frozen=True, slots=True)
class TouchTravel:
    """How it moves.

    Attributes
    ----------
    speed, touch_speed
        On ways, and while it searches, mm/s.
    tip
        Radius of the stylus's ball, mm.
    approach
        How far from the surface the tip begins to search, mm.
    search
        How far beyond where it is expected to touch it goes at most, mm.
    """

    speed: float
    touch_speed: float
    tip: float
    approach: float
    search: float


class TouchProbe(ABC):
    """A machine's stylus. Every wait is bounded; whatever fails leaves the machine where it is."""

    @abstractmethod
    async def begin(self, travel: TouchTravel) -> None:
        """Make ready to move as `travel` says; again with other figures.

        Raises
        ------
        LinkError
            When the machine cannot, or does not count in machine coordinates.
        """

    @abstractmethod
    async def where(self) -> Place:
        """Where the tip is.

        Raises
        ------
        LinkError
            When that cannot be had.
        """

    @abstractmethod
    async def go(self, to: Place) -> None:
        """Move straight; returns when it is there.

        Raises
        ------
        LinkError
            When it is not: a collision, an error of the controller, the link.
        """

    @abstractmethod
    async def touch(self, surface: Place, outward: Place) -> Place:
        """Touch near a place on a surface, and go back; where the tip was when it touched.

        Raises
        ------
        NotTouchedError
            When there is nothing as far as it may go.
        LinkError
            For whatever else goes wrong.
        """

    def turns(self, channel: str) -> bool:
        """Whether a channel of the link shows a rotary axis that `turn` turns."""
        return False

    async def turn(self, angles: Mapping[str, float]) -> None:
        """Turn rotary axes; returns when they are there.

        Parameters
        ----------
        angles
            Channel → what it shall show.

        Raises
        ------
        LinkError
            When they are not, and for an axis that cannot be turned.
        """
        raise LinkError(f"nothing turns {', '.join(angles)}")

    @abstractmethod
    async def clear(self) -> None:
        """Have the controller forget that nothing was touched, where it wants to be told.

        Raises
        ------
        LinkError
            When it does not.
        """

    @abstractmethod
    async def halt(self) -> None:
        """Stop at once; whatever was under way fails. Raises nothing."""


class TouchingLink(ABC):
    """A link, besides, that lets its machine touch something."""

    @abstractmethod
    def touch_probe(self) -> TouchProbe:
        """What moves the machine's stylus and touches."""


def touch_probe_of(link: Link) -> TouchProbe | None:
    """What moves the machine's stylus behind a link; None: this link moves nothing."""
    return link.touch_probe() if isinstance(link, TouchingLink) else None
