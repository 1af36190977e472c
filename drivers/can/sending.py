"""Frames to send from values to write: each message complete, nothing made up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from drivers.can.dbc_config import DbcConfig
from drivers.can.dbc_file import encode, has_fast_data
from drivers.link import LinkError

if TYPE_CHECKING:
    import can
    from cantools.database.can import Message


class Sending:
    """Turns values into frames, and remembers what was written.

    Parameters
    ----------
    name
        The link's name, for messages.
    config
        Its section.
    messages
        The DBC file's, by name.
    """

    def __init__(self, name: str, config: DbcConfig, messages: Mapping[str, Message]) -> None:
        self._name = name
        self._channels = config.channels
        self._messages = messages
        self._written: dict[str, dict[str, float]] = {}

    def frames(self, values: Mapping[str, float]) -> list[can.Message]:
        """One frame for each message of which a signal is named.

        Raises
        ------
        LinkError
            When a channel is not written, a value does not fit, or a message has a signal of which
            nothing is known.
        """
        import can

        wrong = [name for name in values if not self._channels[name].writable]
        if wrong:
            raise self._refused(f"not writable: {', '.join(wrong)} (set writable = true)")
        wanted = self._signals(values)
        frames = []
        for name, signals in wanted.items():
            message = self._messages[name]
            try:
                data = encode(message, self._complete(message, signals))
            except ValueError as error:
                raise self._refused(str(error)) from None
            frames.append(
                can.Message(
                    arbitration_id=message.frame_id,
                    data=data,
                    is_extended_id=message.is_extended_frame,
                    is_fd=message.is_fd,
                    bitrate_switch=message.is_fd and has_fast_data(message),
                )
            )
        self._written |= wanted
        return frames

    def _signals(self, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
        """Message → signal → physical value: start values, what was written last, what is named."""
        wanted: dict[str, dict[str, float]] = {}
        for name, value in values.items():
            section = self._channels[name]
            if section.message not in wanted:
                start = {
                    signal.name: float(str(signal.initial))
                    for signal in self._messages[section.message].signals
                    if signal.initial is not None
                }
                wanted[section.message] = start | self._written.get(section.message, {})
            signal = section.signal or name
            wanted[section.message][signal] = (value - section.offset) / section.scale
        return wanted

    def _complete(self, message: Message, signals: Mapping[str, float]) -> Mapping[str, Any]:
        """The signals that the frame carries, all of them."""
        if message.is_multiplexed():
            return message.gather_signals(dict(signals))
        unknown = [signal.name for signal in message.signals if signal.name not in signals]
        if unknown:
            raise self._refused(
                f"{message.name} also has {', '.join(unknown)}, of which nothing is known: write "
                "them together"
            )
        return signals

    def _refused(self, why: str) -> LinkError:
        return LinkError(f"link {self._name}: nothing written; {why}")
