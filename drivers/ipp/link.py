"""The I++ DME link: positions and temperatures of a CMM that speaks it; its probe on request."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

from abbe.drivers import resources
from abbe.drivers.ipp.asking import Asking
from abbe.drivers.ipp.config import IppConfig
from abbe.drivers.ipp.probing import IppProbe
from abbe.drivers.link import (
    ChannelInfo,
    LinkConfig,
    LinkConfigError,
    Sample,
    WirePlace,
)
from abbe.drivers.reading_link import ReadingLink
from abbe.drivers.touch_probe import TouchingLink, TouchProbe


class IppLink(ReadingLink, TouchingLink):
    """One I++ DME server and its channels.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.
    """

    Config: ClassVar[type[LinkConfig]] = IppConfig
    refusal: ClassVar[str] = (
        "an I++ DME link only reads; the machine is corrected through its controller, "
        "see docs/ipp.md"
    )

    def __init__(self, name: str, config: IppConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._asking = Asking(f"link {name} ({config.host}:{config.port})", config, self.status)

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → by which command it is read, and what becomes of it, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, and the time between two values; nothing is written."""
        unit = self._config.channels[channel].value_unit
        return ChannelInfo(unit, writable=False, every=self._config.every(channel))

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """What it is in the server."""
        section = self._config.channels[channel]
        item = section.axis or section.prop or f"scale temperature {section.scale_temperature}"
        return (WirePlace(self.owns[0], space=(item,), apart=(True,)),)

    @property
    def owns(self) -> tuple[str, ...]:
        """The server."""
        return (resources.tcp(self._config.host, self._config.port),)

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """Axes of one pace always are answers to one ``Get``, or come in one report.

        Raises
        ------
        LinkConfigError
            When `one_sample` is asked for and it takes several commands.
        """
        self._check_known(channels, self._config.channels)
        commands = dict.fromkeys(self._asking.command_of(name) for name in channels)
        if one_sample and len(commands) > 1:
            raise LinkConfigError(
                f"link {self.name}: {', '.join(channels)} must be of one answer, and take several "
                f"commands: {'; '.join(commands)}"
            )

    async def open(self) -> None:
        """Connect, start a session and get a first answer (or report), or begin to retry."""
        await self._asking.reconnector.open()

    async def close(self) -> None:
        """End the session and the connection; a command in flight fails."""
        await self._asking.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read channels: one command for all axes; what is reported is at hand.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        self._check_known(channels, self._config.channels)
        return await self._asking.read(channels)

    def touch_probe(self) -> TouchProbe:
        """The machine's own probe; only who asks for it has the machine moved."""
        return IppProbe(self._asking, self._config.channels)

    def _describe(self, name: str) -> str:
        config, channel = self._config, self._config.channels[name]
        every = config.every(name)
        if channel.axis is not None:
            how = "OnMoveReportE" if config.move_report is not None else "Get"
            parts = [f"{channel.axis} by {how}"]
            if config.coordinates != "any":
                parts.append(f"in {config.coordinates}")
        elif channel.prop is not None:
            which = f", value {channel.item}" if channel.item != 1 else ""
            parts = [f"property {channel.prop}{which}"]
        else:
            parts = [f"temperature of the {channel.scale_temperature} scale"]
        if every:
            parts.append(f"every {every:g} s")
        parts += channel.scaling
        if channel.value_unit:
            parts.append(f"in {channel.value_unit}")
        return ", ".join(parts)
