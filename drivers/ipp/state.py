"""The state of an I++ DME server: stopped by errors, which coordinates."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable

from abbe.drivers.ipp.config import IppConfig
from abbe.drivers.ipp.errors import USE_CLEAR_ALL_ERRORS, ServerError, Severity
from abbe.drivers.ipp.grammar import Value
from abbe.drivers.ipp.question import IppQuestion, coordinate_system
from abbe.drivers.link import LinkStatus
from abbe.drivers.quarantine import MemberHealth

logger = logging.getLogger("abbe.drivers.ipp")

_FIRST_LOOK, _CLEARED = 1.0, 0.1
"""s after a stop before a command is tried again, where somebody else clears the server's errors
and where the link does and it was in vain; doubles from try to try."""
_FRAMES = 3.0
"""Times that the coordinate system may be asked for in vain before it counts as unknown."""
_SERVER, _COORDINATES = "server", "coordinates"


class ServerState:
    """The state of a server: whether it carries out commands, and its coordinate system.

    Parameters
    ----------
    label
        The link, for people.
    config
        Its section.
    status, roster
        Kept up to date.

    Attributes
    ----------
    stopped
        Why the server refuses commands and what to do, for people; empty while it does not.
    misplaced
        Why positions are not in the coordinates that are wanted; empty when they are.
    """

    def __init__(
        self, label: str, config: IppConfig, status: LinkStatus, health: MemberHealth
    ) -> None:
        self._label = label
        self._config = config
        self._status = status
        self._health = health
        self.stopped = ""
        self.misplaced = ""
        self._delay = 0.0
        self._resumed_at = -config.quarantine_max
        self._look_at = 0.0
        self._frame_at = self._frame_seen_at = 0.0
        self._warned: set[int] = set()

    def renew(self, questions: Iterable[IppQuestion]) -> None:
        """A new connection: what was learned on an earlier one need not hold."""
        for question in questions:
            question.accepted()
            question.pace.clear()
            self._status.quarantined.pop(question.name, None)
        for key in (_SERVER, _COORDINATES):
            self._status.quarantined.pop(key, None)
        self.stopped = ""
        self.misplaced = "" if self._config.coordinates == "any" else "coordinates not known yet"
        self._frame_at, self._frame_seen_at = 0.0, time.monotonic()
        self._warned.clear()

    def halt(self, error: ServerError, question: IppQuestion | None = None) -> None:
        """An error stopped the server; of a question, or of its own."""
        fresh = self._begin_stop(error)
        if question is not None and error.own_fault:
            before, why = question.refused, f"{question.name} is refused: {error}"
            then = question.refuse(why, time.monotonic(), self._config.quarantine_max)
            if not before or not question.vital:
                logger.warning("%s: %s; %s", self._label, why, then)
            self._show(question.name, why)
        if fresh:
            logger.warning("%s: %s", self._label, self.stopped)
        self._show(_SERVER, self.stopped)

    def _begin_stop(self, error: ServerError) -> bool:
        now, longest = time.monotonic(), self._config.quarantine_max
        fresh, clears = not self.stopped, self._config.clear_errors
        if fresh and now - self._resumed_at >= longest:
            self._delay = 0.0 if clears else _FIRST_LOOK
        else:
            self._delay = min(max(2.0 * self._delay, _CLEARED if clears else _FIRST_LOOK), longest)
        self._look_at = now + self._delay
        if fresh or error.number != USE_CLEAR_ALL_ERRORS:
            cure = "the link clears it" if clears else "ClearAllErrors() is needed"
            self.stopped = f"the server is stopped by {error}; {cure}"
        return fresh

    def try_again(self, now: float) -> bool:
        """Whether a command may be sent to a stopped server, to see whether it still is."""
        return now >= self._look_at

    def accepted(self, question: IppQuestion) -> None:
        """A question that was refused is answered."""
        if question.refused:
            logger.warning("%s: %s is answered again", self._label, question.name)
            question.accepted()
            self._show(question.name, "")

    def resume(self) -> None:
        """A command was carried out: the server is not stopped (any more)."""
        if self.stopped:
            self.stopped = ""
            self._resumed_at = time.monotonic()
            logger.warning("%s: the server's errors are cleared", self._label)
            self._show(_SERVER, "")

    def warn(self, error: ServerError) -> None:
        """An error that stops nothing; logged once a connection."""
        if error.number not in self._warned:
            self._warned.add(error.number)
            level = logging.WARNING if error.severity is Severity.WARNING else logging.INFO
            logger.log(level, "%s: %s", self._label, error)

    def frame_is_due(self, now: float) -> bool:
        """Whether to ask for the coordinate system."""
        return now >= self._frame_at

    def lost_frame(self, now: float) -> str:
        """Since when the coordinate system is not stated, for people; empty while it is known."""
        config, age = self._config, now - self._frame_seen_at
        limit = _FRAMES * config.coordinates_every + config.timeout
        if config.coordinates == "any" or age <= limit:
            return ""
        return self.misplaced or f"the server has not stated its coordinate system for {age:.1f} s"

    def look_at_frame(self, data: tuple[Value, ...], asked_at: float) -> None:
        """Take note of the coordinate system that the server named when asked at `asked_at`.

        Raises
        ------
        LinkProtocolError
            When it named none.
        """
        wanted, found = self._config.coordinates, coordinate_system(data)
        self._frame_at, self._frame_seen_at = asked_at + self._config.coordinates_every, asked_at
        before, self.misplaced = self.misplaced, ""
        if found != wanted:
            self.misplaced = f"positions are in {found}, and {wanted} is wanted"
        if self.misplaced != before:
            if self.misplaced:
                logger.warning("%s: %s", self._label, self.misplaced)
            self._show(_COORDINATES, self.misplaced)

    def _show(self, key: str, why: str) -> None:
        self._status.quarantined.pop(key, None)
        if why:
            self._status.quarantined[key] = why
        self._health.show()
