"""Error counters of a simulated CAN controller, and the states that follow from them.

ISO 11898-1, fault confinement: a transmission that fails costs eight, one that succeeds takes one
back; one is added for an error that is heard. From 96 on controllers warn, from 128 on they are
error passive, and a transmit counter of 256 takes them off the bus until somebody restarts them. An
error passive transmitter that nobody acknowledges does not count any further: alone on a bus, a
controller never gets bus-off.
"""

from __future__ import annotations

_WARNING, _PASSIVE, _BUS_OFF = 96, 128, 256


class FaultConfinement:
    """One controller's counters.

    Attributes
    ----------
    transmit, receive
        The error counters.
    """

    def __init__(self) -> None:
        self.transmit = 0
        self.receive = 0

    @property
    def state(self) -> str:
        """``active``, ``warning``, ``passive`` or ``off``."""
        worst = max(self.transmit, self.receive)
        if self.transmit >= _BUS_OFF:
            return "off"
        if worst >= _PASSIVE:
            return "passive"
        return "warning" if worst >= _WARNING else "active"

    def restart(self) -> None:
        """What opening the controller anew does."""
        self.transmit = self.receive = 0

    def sent(self) -> None:
        """A transmission succeeded."""
        self.transmit = max(0, self.transmit - 1)

    def received(self) -> None:
        """A frame was received; an error passive receiver falls back below the limit at once."""
        self.receive = min(_PASSIVE - 1, max(0, self.receive - 1))

    def spoilt(self) -> None:
        """Somebody else's frame was destroyed."""
        self.receive = min(self.receive + 1, _PASSIVE)

    def fail(self, *, acknowledge: bool) -> None:
        """A transmission failed, and is repeated until it succeeds or cannot be repeated.

        Parameters
        ----------
        acknowledge
            Whether all that failed was that nobody acknowledged it.
        """
        limit = _PASSIVE if acknowledge else _BUS_OFF
        while self.transmit < limit:
            self.transmit += 8
