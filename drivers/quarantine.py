"""The health of a bus's members: a silent one is left alone for a while that doubles.

So that one dead unit does not cost the others their data. A *member* is whatever is asked and may
stay silent by itself: a Modbus unit, a node on a CAN bus, a query of a serial line.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from abbe.drivers.link import LinkState
from abbe.drivers.reconnect import ReconnectConfig, Reconnector


class QuarantineConfig(ReconnectConfig):
    """How long a silent member is waited for and left alone."""

    timeout: Annotated[float, Field(gt=0, le=60)] = 0.3
    """s for an answer to begin; on a serial line the time on the wire comes on top."""
    quarantine_after: Annotated[int, Field(ge=1)] = 2
    """Requests in a row that a member may leave unanswered before it is left alone for a while."""
    quarantine_max: Annotated[float, Field(gt=0)] = 10.0
    """s; the while begins at two time-outs and doubles up to this."""


@dataclass(slots=True, eq=False)
class Member:
    """One member's health.

    Attributes
    ----------
    name
        For people: ``unit 3``.
    failures
        Requests in a row that it left unanswered.
    retry_at
        Monotonic time in s before which it is not asked again; matters while `failures`.
    asked
        Whether it was ever asked.
    reported
        Whether its silence was logged.
    why
        What is the matter with it, for people.
    """

    name: str
    failures: int = 0
    retry_at: float = 0.0
    asked: bool = False
    reported: bool = False
    why: str = ""

    def answered(self) -> None:
        """Take note of an answer."""
        self.failures = 0
        self.why = ""

    def unanswered(self, now: float, why: str, config: QuarantineConfig) -> None:
        """Take note of a request without an answer; from `quarantine_after` on, set it apart.

        The first quarantine lasts two time-outs, each further one twice as long.
        """
        self.failures += 1
        self.why = why if self.failures == 1 else f"{why}, {self.failures} times in a row"
        beyond = self.failures - config.quarantine_after
        # 2^30 time-outs are beyond any quarantine_max; the bound keeps the power finite.
        wait = 2.0 * config.timeout * 2.0 ** min(beyond, 30) if beyond >= 0 else 0.0
        self.retry_at = now + min(wait, config.quarantine_max)

    def refusal(self, now: float) -> str:
        """Why it must not be asked now; empty when it may be."""
        wait = self.retry_at - now
        if not self.failures or wait <= 0:
            return ""
        return f"{self.why}; asked again in {wait:.1f} s"


class MemberHealth:
    """The health of all members of a bus; keeps the link's status and its log.

    Parameters
    ----------
    members
        All of them.
    config
        Their quarantine.
    reconnector
        The bus's connection; reported lost when every member that was asked is silent.
    logger
        Where a member's silence and return are logged, one line each.
    noun
        What members are called, for people: ``unit``.
    """

    def __init__(
        self,
        members: Collection[Member],
        config: QuarantineConfig,
        reconnector: Reconnector,
        logger: logging.Logger,
        noun: str,
    ) -> None:
        self._members = members
        self._config = config
        self._reconnector = reconnector
        self._logger = logger
        self._noun = noun
        self.silent_in_a_row = 0
        """Requests in a row to which nothing at all came."""

    def answered(self, member: Member) -> None:
        """Take note of an answer; cheap to skip while the member has no `failures`."""
        self.silent_in_a_row = 0
        member.answered()
        if self._reconnector.status.quarantined.pop(member.name, None) is not None:
            self.show()
        if member.reported:
            member.reported = False
            self._logger.warning("%s: %s answers again", self._reconnector.label, member.name)

    def unanswered(self, member: Member, why: str, *, bus_silent: bool = True) -> None:
        """Take note of silence; `bus_silent` is False when something answered in its place."""
        after, reconnector = self._config.quarantine_after, self._reconnector
        member.unanswered(time.monotonic(), why, self._config)
        self.silent_in_a_row = self.silent_in_a_row + 1 if bus_silent else 0
        asked = [m for m in self._members if m.asked]
        if self.silent_in_a_row >= after and all(m.failures for m in asked):
            reconnector.status.quarantined[member.name] = member.why
            reconnector.lost(f"connected, and no {self._noun} answers: {why}")
        elif member.failures >= after:
            self.set_apart(member, why)

    def set_apart(self, member: Member, why: str) -> None:
        """Take note that a member is not to be used for now; logged once until it answers."""
        member.failures = max(member.failures, 1)
        member.why = member.why or why
        self._reconnector.status.quarantined[member.name] = member.why
        self.show()
        if self._reconnector.up and not member.reported:
            member.reported = True
            self._logger.warning("%s: %s set apart: %s", self._reconnector.label, member.name, why)

    def renew(self) -> None:
        """A new connection: everybody may be asked at once."""
        self.silent_in_a_row = 0
        for member in self._members:
            member.retry_at = 0.0
        self.show()

    def show(self, *more: str) -> None:
        """Bring the link's state up to date; `more` is what else is wrong, for people."""
        reconnector = self._reconnector
        if not reconnector.up:
            return
        wrong = [*reconnector.status.quarantined.values(), *more]
        reconnector.status.become(LinkState.DEGRADED if wrong else LinkState.UP, "; ".join(wrong))
