"""Channels as a configuration names them: ``link.channel``, found among the links."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.config.sections.config_file import ConfigFile
from abbe.drivers.link import ChannelInfo, Link
from abbe.drivers.transducers import AnyTransducerConfig, Degrees, Transducer, make_transducer

Key = tuple[str | int, ...]
"""Where something stands in the file: the keys that lead to it."""


def split(channel: str) -> tuple[str, str]:
    """``"cmm.count_X"`` → ``("cmm", "count_X")``."""
    link, _, name = channel.partition(".")
    return link, name


def transducer_of(axis: str, unit: str, config: AnyTransducerConfig | None) -> Transducer | None:
    """What converts a position of an axis: mm, or rad where it is rotary, inside.

    Parameters
    ----------
    axis
        Its name.
    unit
        Of the channel.
    config
        The section's transducer, if it has one.

    Returns
    -------
    None where nothing is to be converted. Degrees, of a channel or of a transducer, become rad.
    """
    found = None if config is None else make_transducer(config)
    given = unit if found is None else found.unit
    return Degrees(found) if is_rotary(axis) and given in ("deg", "°") else found


@dataclass(frozen=True)
class Channels:
    """All channels of a configuration.

    Attributes
    ----------
    source
        The file, for the places of errors.
    file
        Its sections.
    links
        Its links, made but not opened.
    """

    source: TomlSource
    file: ConfigFile
    links: Mapping[str, Link]

    def find(self, channel: str, key: Sequence[str | int]) -> tuple[str, str]:
        """Link and name of a channel that there is.

        Raises
        ------
        InputError
            When there is none of that name; lists those that there are.
        """
        link, name = split(channel)
        if link not in self.links:
            raise self.source.error(
                f"no link {link!r}",
                key,
                found=channel,
                expected="a channel of one of " + ", ".join(self.links),
            )
        channels = self.links[link].channels
        if name not in channels:
            raise self.source.error(
                f"link {link} has no channel {name!r}",
                key,
                found=channel,
                expected="one of " + ", ".join(channels),
            )
        return link, name

    def info(self, channel: str) -> ChannelInfo:
        """What is known of a channel that there is."""
        link, name = split(channel)
        return self.links[link].info(name)

    def written(self) -> Iterator[tuple[str, Key]]:
        """Every channel that is written, and where the file says so."""
        output = self.file.output
        for name, section in output.axes.items():
            yield section.target, ("output", "axes", name, "target")
        for name in ("status", "heartbeat"):
            if (channel := getattr(output, name)) is not None:
                yield channel, ("output", name)
        for i, echo in enumerate(output.echo):
            yield echo.target, ("output", "echo", i, "target")
        yield from self.reported()

    def reported(self) -> Iterator[tuple[str, Key]]:
        """Those of them that say how sure the correction is, at a pace of their own."""
        output = self.file.output
        for name, channel in output.plus_minus.items():
            yield channel, ("output", "plus_minus", name)
        if output.outside is not None:
            yield output.outside, ("output", "outside")

    def read(self) -> Iterator[tuple[str, Key]]:
        """Every channel that is read, and where the file says so."""
        file = self.file
        for kind in ("axes", "signals", "reference"):
            for name, section in getattr(file, kind).items():
                if section.source is not None:
                    yield section.source, (kind, name, "source")
        for name, axis in file.axes.items():
            if axis.direction is not None:
                yield axis.direction, ("axes", name, "direction")
        for i, channel in enumerate(file.tool.sources or ()):
            yield channel, ("tool", "sources", i)
        for name in WATCHED:
            if (channel := getattr(file.controller, name)) is not None:
                yield channel, ("controller", name)
        for i, echo in enumerate(file.output.echo):
            yield echo.source, ("output", "echo", i, "source")
        for name, point in file.checks.points.items():
            place: Key = ("checks", "points", name)
            yield point.trigger, (*place, "trigger")
            for i, channel in enumerate(point.found or ()):
                yield channel, (*place, "found", i)
            if point.value is not None:
                yield point.value, (*place, "value")


WATCHED = ("heartbeat", "status", "sample", "clock")
"""Keys of [controller] that name a channel."""
