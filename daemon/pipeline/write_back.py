"""Write back: corrected positions, status word and heartbeat → the controller."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from daemon.pipeline.poll import Batch, Channel
from drivers.link import Link, LinkError, LinkState
from drivers.transducers import SensorFaultError, Transducer

logger = logging.getLogger("abbe.pipeline")

_OPEN = (LinkState.UP, LinkState.DEGRADED)
_HEARTBEATS = 1 << 16


@dataclass(frozen=True, slots=True)
class Target:
    """Where one axis's corrected position goes.

    Attributes
    ----------
    axis
        Its name.
    channel
        Where it is written.
    transducer
        Read backwards, mm → counts; None where the channel takes mm.
    """

    axis: str
    channel: Channel
    transducer: Transducer | None = None


class WriteBack:
    """Writes one cycle's answer, in one batch for each link.

    Parameters
    ----------
    links
        All links.
    targets
        Axes that are written.
    echo
        Channels that are written as they were read: (source, target).
    status, heartbeat
        Where the status word and the heartbeat go, None: nowhere.
    """

    def __init__(
        self,
        links: Mapping[str, Link],
        targets: Sequence[Target],
        echo: Sequence[tuple[Channel, Channel]] = (),
        status: Channel | None = None,
        heartbeat: Channel | None = None,
    ) -> None:
        self._links = links
        self._steps = tuple(
            (t.axis, *t.channel, None if t.transducer is None else t.transducer.inverse)
            for t in targets
        )
        self._echo = tuple(echo)
        self._status = status
        self._heartbeat = heartbeat
        written = [status, *(t.channel for t in targets), *(c for _, c in echo), heartbeat]
        self._order = tuple(dict.fromkeys(c[0] for c in written if c is not None))
        self._beats = 0
        self._broken: set[str] = set()

    async def __call__(
        self, corrected: Sequence[float], batch: Batch, status: int
    ) -> tuple[bool, str]:
        """Write what is known.

        Parameters
        ----------
        corrected
            For each target, mm; NaN where the indicated position is not to be believed: then the
            controller's register is left alone.
        batch
            What was read in this cycle, for the echo.
        status
            The status word.

        Returns
        -------
        Whether all targets were written, and what went wrong (empty when nothing did).
        """
        values, complete, problem = self._values(corrected, batch, status)
        if len(values) == 1:
            ((link, channels),) = values.items()
            failure = await self._write(link, channels)
        else:
            failures = await asyncio.gather(*(self._write(*item) for item in values.items()))
            failure = "; ".join(filter(None, failures))
        if failure:
            return False, failure
        return complete, problem

    def _values(
        self, corrected: Sequence[float], batch: Batch, status: int
    ) -> tuple[dict[str, dict[str, float]], bool, str]:
        """What is written, by link and channel; whether it is complete; and why it is not."""
        values: dict[str, dict[str, float]] = {name: {} for name in self._order}
        problem, complete = "", True
        if self._status is not None:
            values[self._status[0]][self._status[1]] = status
        for (axis, link, name, encode), position in zip(self._steps, corrected, strict=True):
            if position != position:
                complete = False
                continue
            if encode is not None:
                try:
                    position = encode(position)
                except SensorFaultError as error:
                    problem, complete = f"{axis} cannot be written: {error}", False
                    continue
            values[link][name] = position
        if complete and batch:
            for (source_link, source), (link, name) in self._echo:
                sample = batch[source_link][source]
                if sample.good:
                    values[link][name] = sample.value
        if self._heartbeat is not None:
            self._beats = (self._beats + 1) % _HEARTBEATS
            values[self._heartbeat[0]][self._heartbeat[1]] = self._beats
        return values, complete, problem

    async def _write(self, name: str, channels: Mapping[str, float]) -> str:
        if not channels:
            return ""
        link = self._links[name]
        if link.status.state not in _OPEN:
            return f"link {name} is {link.status.state.value}"
        try:
            await link.write(channels)
        except LinkError as error:
            return str(error)
        except Exception as error:
            # a link raises LinkError only; a driver that does not must not end the rest
            if name not in self._broken:
                self._broken.add(name)
                logger.exception("link %s: its driver failed while writing", name)
            return f"link {name}: its driver failed: {error}"
        self._broken.discard(name)
        return ""
