"""A simulated CAN bus: every member receives what another one sends.

Three kinds of ends: devices (callbacks in this process), a LAWICEL (slcan) adapter on a
pseudo-terminal (`can_adapter`), and python-can's ``udp_multicast``.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import NamedTuple


class CanFrame(NamedTuple):
    """One CAN frame; an error frame is not on the wire, the adapter makes it up."""

    id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    error: bool = False
    length: int = 0
    """Of a remote frame's answer."""


Hearer = Callable[[CanFrame], None]


def _unmoved() -> None:
    """Devices take no notice of their controllers' troubles."""


class CanWire:
    """A CAN bus in this process.

    Attributes
    ----------
    broken
        Nothing comes through any more.
    """

    def __init__(self) -> None:
        self._ends: list[tuple[Hearer, Callable[[], None], Callable[[], None]]] = []
        self._speaking = 0
        self._began = 0.0
        self.broken = False
        self._shorted = self._lonely = False

    @property
    def time(self) -> float:
        """The moment (monotonic, s): the same for all who hear one frame."""
        return self._began if self._speaking else time.monotonic()

    @property
    def shorted(self) -> bool:
        """CAN-H and CAN-L touch: every frame is destroyed, and all hear that."""
        return self._shorted

    @property
    def lonely(self) -> bool:
        """The cable is off behind the adapter: nobody is there who acknowledges."""
        return self._lonely

    def set_faults(self, *, shorted: bool = False, lonely: bool = False) -> None:
        """Have these faults, and no others."""
        self._shorted, self._lonely = shorted, lonely
        if not shorted and not lonely:
            for _, _, mended in self._ends:
                mended()

    def join(
        self,
        hear: Hearer,
        spoilt: Callable[[], None] = _unmoved,
        mended: Callable[[], None] = _unmoved,
    ) -> Callable[[CanFrame], None]:
        """Add an end; hands back the function by which it speaks.

        Parameters
        ----------
        hear
            Called with others' frames.
        spoilt
            Called when somebody else's frame was destroyed.
        mended
            Called when frames come through again.
        """
        self._ends.append((hear, spoilt, mended))

        def speak(frame: CanFrame) -> None:
            if self.broken or self._lonely:
                return
            self._began = self.time
            self._speaking += 1
            try:
                for other, destroyed, _ in self._ends:
                    if other is hear:
                        continue
                    if self._shorted:
                        destroyed()
                    else:
                        other(frame)
            finally:
                self._speaking -= 1

        return speak


class MulticastEnd:
    """The wire's way out over python-can's ``udp_multicast`` (needs the package msgpack).

    Parameters
    ----------
    wire
        The bus.
    group, port
        Multicast address and UDP port; nothing leaves this computer.
    """

    def __init__(self, wire: CanWire, group: str, port: int) -> None:
        import can

        self._message = can.Message
        self._bus = can.Bus(
            interface="udp_multicast",
            channel=group,
            port=port,
            hop_limit=0,
            fd=False,
            ignore_config=True,
        )
        self._speak = wire.join(self._hear)
        asyncio.get_running_loop().add_reader(self._bus.fileno(), self._receive)

    def close(self) -> None:
        """Leave the group."""
        asyncio.get_running_loop().remove_reader(self._bus.fileno())
        self._bus.shutdown()

    def _hear(self, frame: CanFrame) -> None:
        self._bus.send(
            self._message(
                arbitration_id=frame.id,
                data=frame.data,
                is_extended_id=frame.extended,
                is_remote_frame=frame.remote,
                is_error_frame=frame.error,
                dlc=frame.length if frame.remote else len(frame.data),
            )
        )

    def _receive(self) -> None:
        message = self._bus.recv(0)
        if message is not None:
            self._speak(
                CanFrame(
                    message.arbitration_id,
                    bytes(message.data),
                    message.is_extended_id,
                    message.is_remote_frame,
                    message.is_error_frame,
                    message.dlc,
                )
            )
