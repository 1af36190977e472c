"""The end of a run: the status word 0 for the controller, or a message to a person."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta

from abbe.compcore.errors import AbbeError
from abbe.compcore.machine.conditions import unit_of
from abbe.daemon.pipeline.reading.poll import Channel
from abbe.daemon.pipeline.writing.write_back import OPEN, AxisTarget, Held, WriteBack
from abbe.daemon.status_word import STOPPED, describe
from abbe.drivers.link import Link, LinkError

_AGAIN = 0.05
"""s between two attempts."""


class NotReportedError(AbbeError):
    """The controller may still take corrected positions for fresh ones."""


class Ending:
    """The last write of a run, and what the controller holds where it failed.

    Parameters
    ----------
    links
        All links.
    write_back
        Knows what was written.
    status
        Where the status word goes, None: nowhere; then there is no last word.
    targets
        Axes that are written.
    fresh
        s for which what was written last counts as of the last cycle.
    """

    def __init__(
        self,
        links: Mapping[str, Link],
        write_back: WriteBack,
        status: Channel | None,
        targets: Sequence[AxisTarget],
        fresh: float,
    ) -> None:
        self._links = links
        self._write_back = write_back
        self._status = status
        self._targets = tuple(targets)
        self._fresh = fresh
        self.problem = "it was not tried"
        """Why the word was not said; empty once it was."""

    async def tell(self, within: float) -> None:
        """Write 0 into the status word, by itself, until it is taken or `within` s are over.

        By itself, because a block is refused as a whole for the sake of one of its registers. A
        driver that does not come back is not waited for any longer than that. Where there is no
        status word, the ramp is all that there is to tell: then it is seen whether it was taken.
        Over a link that nothing was ever written over there is nothing to take back.
        """
        if self._status is None:
            self.problem = self._not_ramped()
            return
        link, channel = self._status
        nothing_written = all(name != link for name, _ in self._write_back.held)
        if link in self._write_back.others or nothing_written:
            self.problem = ""  # the word is somebody else's, or may be: it was never ours
            return
        until = time.monotonic() + within
        while True:
            self.problem = await self._try(self._links[link], channel, until)
            left = until - time.monotonic()
            if not self.problem or left <= _AGAIN:
                return
            await asyncio.sleep(_AGAIN)

    def _not_ramped(self) -> str:
        """Which axis was not written in the end; empty: none."""
        held, now = self._write_back.held, time.monotonic()
        for target in self._targets:
            found = held.get(target.channel)
            if found is not None and not (found.sure and now - found.time <= self._fresh):
                return (
                    f"corrected {target.axis} was not taken in the end, and it has no status word"
                )
        return ""

    async def _try(self, link: Link, channel: str, until: float) -> str:
        if link.status.state not in OPEN:
            return f"link {link.name} is {link.status.state.value}"
        writing = asyncio.ensure_future(link.write(self._message(link, channel), until=until))
        done, _ = await asyncio.wait({writing}, timeout=max(0.0, until - time.monotonic()))
        if not done:
            writing.cancel()
            return f"link {link.name} does not come back"
        error = None if writing.cancelled() else writing.exception()
        if isinstance(error, LinkError):
            return str(error)
        if error is not None:
            return f"link {link.name}: its driver failed: {error}"
        return ""

    def _message(self, link: Link, channel: str) -> dict[str, float]:
        """The word, and what the link cannot send apart from it, as the controller has it."""
        held = self._write_back.held
        along = {
            name: held[link.name, name].value
            for name in link.goes_with(channel)
            if (link.name, name) in held
        }
        return along | {channel: STOPPED}

    def check(self) -> None:
        """See that nobody takes the controller's registers for fresh ones.

        Nothing is wrong where nothing was ever written: there is nothing to take back.

        Raises
        ------
        NotReportedError
            When the status word was not taken: why, and what the controller was last known to
            hold.
        """
        held = self._write_back.held
        if self.problem and held:
            raise NotReportedError(
                f"the controller could not be told that Abbe has ended: {self.problem}; "
                f"last known to hold {self._words(held)}"
            )

    def _words(self, held: Mapping[Channel, Held]) -> str:
        said = []
        if self._status is not None and self._status in held:
            found = held[self._status]
            word = int(found.value)
            said.append(f"status word {word:#06x} ({describe(word)}){_at(found)}")
        for target in self._targets:
            if target.channel in held:
                found = held[target.channel]
                transducer = target.transducer
                unit = unit_of(target.axis) if transducer is None else transducer.raw_unit
                said.append(f"{target.axis} {found.value:.10g} {unit}{_at(found)}")
        return ", ".join(said) or "nothing of this"


def _at(held: Held) -> str:
    """When it was written, as a clock on the wall says it."""
    at = datetime.now() - timedelta(seconds=time.monotonic() - held.time)
    return f" {'since' if held.sure else 'perhaps since'} {at:%H:%M:%S}"
