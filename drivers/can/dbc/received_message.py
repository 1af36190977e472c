"""Received messages of a CAN bus: the last frame of each, and the values in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.file import decoder, signal_of, within_of
from abbe.drivers.link import Quality, Sample
from abbe.drivers.pace import Pace
from abbe.drivers.quarantine import Member

if TYPE_CHECKING:
    from cantools.database.can import Message

_NAN = float("nan")


class ReceivedMessage(Member):
    """A message that is received: how it is asked for, and what came last.

    Attributes
    ----------
    data, came
        Its last frame and when it came (monotonic, s); None and −inf when none did.
    taken
        The earliest moment at which its values can have been taken (monotonic, s).
    pace
        When it is asked for.
    asked_at
        Monotonic time in s of a request whose answer may still come; None when none can.
    values
        Channel → sample, worked out when asked for; of a multiplexed message when it comes.
    """

    __slots__ = (
        "_conversions", "_decode", "_limit", "_multiplexed", "asked_at", "came", "channels",
        "data", "fresh", "message", "pace", "request", "taken", "values", "within",
    )  # fmt: skip

    def __init__(self, message: Message, config: DbcConfig) -> None:
        super().__init__(f"message {message.name}")
        section = config.messages.get(message.name)
        self.message = message
        self._multiplexed = message.is_multiplexed()
        self.within = within_of(message, section.within if section else None)
        self.request = section.request if section else None
        self.pace = Pace(section.every if section else 0.0)
        self.channels = {
            name: (signal_of(message, name, channel).name, channel)
            for name, channel in config.channels.items()
            if channel.message == message.name and not channel.writable
        }
        self._conversions = [
            (name, signal, channel.value_of) for name, (signal, channel) in self.channels.items()
        ]
        self._limit = max(self.within, self.pace.every)
        self._decode = decoder(message, {signal for signal, _ in self.channels.values()})
        self.clear()

    def clear(self) -> None:
        """Forget what came: a new connection."""
        self.data: bytes | None = None
        self.came = self.taken = float("-inf")
        self.pace.clear()
        self.asked_at: float | None = None
        self.fresh = False
        self.values: dict[str, Sample] = {}

    def take(self, data: bytes, arrived: float, asked_at: float | None = None) -> None:
        """A frame came (monotonic, s), as the answer to a request where one was sent."""
        self.data, self.came, self.fresh = data, arrived, True
        self.taken = arrived if asked_at is None else min(arrived, asked_at)
        self.asked_at = None
        if self._multiplexed or asked_at is not None:
            self.work_out()
        if asked_at is not None and self.pace.every:
            good = all(name in self.values and self.values[name].good for name in self.channels)
            self.pace.asked(asked_at, good=good)

    def work_out(self) -> None:
        """Bring `values` up to date with the last frame."""
        self.fresh = False
        if self.data is None:
            return
        taken = self.taken
        try:
            values = self._decode(self.data)
        except ValueError as error:
            self.values = dict.fromkeys(self.channels, Sample(_NAN, taken, Quality.BAD, str(error)))
            return
        for name, signal, value_of in self._conversions:
            if signal not in values:
                continue
            value = value_of(float(values[signal]))
            if value - value == 0.0:
                self.values[name] = Sample(value, taken)
            else:
                why_not = f"{self.message.name}.{signal} is {value}"
                self.values[name] = Sample(_NAN, taken, Quality.BAD, why_not)

    def sample(self, channel: str, now: float) -> Sample:
        """A channel's last value; unavailable when it did not come again for too long."""
        if self.fresh:
            self.work_out()
        sample = self.values.get(channel)
        if sample is not None and now - sample.time <= self._limit:
            return sample
        if now - self.came <= self._limit:
            why = f"{self.name} comes, but its page with {self.channels[channel][0]} does not"
        else:
            why = self.silence(now)
        return Sample(_NAN, now, Quality.UNAVAILABLE, why)

    def silence(self, now: float) -> str:
        """Why there is no value, for people."""
        since = f"for {now - self.came:.1f} s" if self.data is not None else "yet"
        return self.why or f"{self.name} did not come {since}"
