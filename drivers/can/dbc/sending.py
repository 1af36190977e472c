"""Frames to send, from values to write: complete, nothing made up, nothing repeated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.file import encode, has_fast_data, page_of, signal_of
from abbe.drivers.link import LinkConfigError, LinkError

if TYPE_CHECKING:
    import can
    from cantools.database.can import Message


class OutgoingFrame(NamedTuple):
    """A frame to send.

    Attributes
    ----------
    channels
        Whose values it carries.
    content
        Itself.
    """

    channels: tuple[str, ...]
    content: can.Message


class Sending:
    """The encoder of values into frames.

    A message that carries several channels goes out with all of them or not at all: the value of
    one that is left out is not to be believed, and must not go out again as if it were new.

    Parameters
    ----------
    name
        The link's name, for messages.
    config
        Its section.
    messages
        The DBC file's, by name.

    Raises
    ------
    LinkConfigError
        When channels are written that stand on different pages of one message.
    """

    def __init__(self, name: str, config: DbcConfig, messages: Mapping[str, Message]) -> None:
        self._name = name
        self._channels = config.channels
        self._messages = messages
        self._together: dict[str, dict[str, str]] = {}
        """Message → channel → signal, of those that are written."""
        for channel, section in config.channels.items():
            if section.writable:
                signal = signal_of(messages[section.message], channel, section)
                self._together.setdefault(section.message, {})[channel] = signal.name
        self._start = {message: self._start_values(message) for message in self._together}

    def goes_with(self, channel: str) -> frozenset[str]:
        """Channels that go out in one frame with `channel`."""
        return frozenset(self._together[self._channels[channel].message])

    def frames(self, values: Mapping[str, float]) -> list[OutgoingFrame]:
        """One frame for each message of which signals are named.

        Raises
        ------
        LinkError
            When a channel is not written, a value does not fit, or a message has a signal of which
            nothing is known; nothing is sent then.
        """
        wrong = [name for name in values if not self._channels[name].writable]
        if wrong:
            raise self._refused(f"not writable: {', '.join(wrong)} (set writable = true)", values)
        frames = []
        for name in dict.fromkeys(self._channels[channel].message for channel in values):
            together = self._together[name]
            if left_out := [channel for channel in together if channel not in values]:
                raise self._refused(
                    f"{name} also carries {', '.join(left_out)}, whose last value would go out "
                    "again as if it were new: write them together",
                    values,
                )
            signals = self._start[name] | {
                signal: self._physical(channel, values[channel])
                for channel, signal in together.items()
            }
            try:
                frames.append(OutgoingFrame(tuple(together), self._frame(name, signals)))
            except ValueError as error:
                raise self._refused(str(error), values) from None
        return frames

    def _physical(self, channel: str, value: float) -> float:
        section = self._channels[channel]
        return section.number_of(value)

    def _frame(self, name: str, signals: Mapping[str, float]) -> can.Message:
        import can

        message = self._messages[name]
        pages = self._pages(name)
        unknown = [
            signal.name
            for signal in message.signals
            if signal.name not in signals and page_of(message, signal.name) in (None, *pages)
        ]
        if unknown:
            raise ValueError(
                f"{name} also has {', '.join(unknown)}, of which nothing is known: make them "
                "channels with writable = true"
            )
        return can.Message(
            arbitration_id=message.frame_id,
            data=encode(message, signals),
            is_extended_id=message.is_extended_frame,
            is_fd=message.is_fd,
            bitrate_switch=message.is_fd and has_fast_data(message),
        )

    def _pages(self, name: str) -> set[tuple[str, int]]:
        """Pages of a message on which signals stand that are written."""
        signals = self._together[name].values()
        return {page for signal in signals if (page := page_of(self._messages[name], signal))}

    def _start_values(self, name: str) -> dict[str, float]:
        """What the file says of signals that no channel writes, and the page that is written."""
        start = {
            signal.name: float(str(signal.initial))
            for signal in self._messages[name].signals
            if signal.initial is not None
        }
        pages = self._pages(name)
        if len(pages) > 1:
            channels = list(self._together[name])
            raise LinkConfigError(
                f"channels {', '.join(channels)} stand on different pages of message {name}: "
                "a frame has one of them",
                ("channels", channels[-1]),
            )
        return start | {multiplexer: float(number) for multiplexer, number in pages}

    def _refused(self, why: str, values: Mapping[str, float]) -> LinkError:
        return LinkError(f"link {self._name}: nothing written; {why}").leaving(untouched=values)
