"""Frames that come over python-can's ``udp_multicast``, taken from its socket in one step each.

python-can waits, looks at the time, filters and checks anew for each frame, our own included, which
this interface gives back; that is half of what a request costs here. And where one datagram of the
group is no frame, its receiving fails. Here such a one is passed over.
"""

from __future__ import annotations

import os
import socket
import struct
import time
from typing import TYPE_CHECKING

from drivers.awaited import is_there

if TYPE_CHECKING:
    import can

_LONGEST = 4096
"""Bytes; python-can's own limit."""
_MOST_PASSED_OVER = 64
"""Datagrams in a row."""
_REMOTE = b"\xafis_remote_frame\xc3"
"""What a remote frame's datagram has in it: a key of 15 characters, true."""
_CLASSIC = 166
"""Bytes: shorter datagrams have no payload (17 bytes, CAN FD) that could hold it by itself."""
_TIME = struct.Struct("@ll")
_TIMESTAMP = 35
"""SO_TIMESTAMPNS, which python-can has switched on: seconds and nanoseconds at arrival."""


class Datagrams:
    """What receives in place of an open ``udp_multicast`` bus.

    Parameters
    ----------
    bus
        python-can's; it goes on sending.
    """

    def __init__(self, bus: can.BusABC) -> None:
        import can
        import msgpack

        self._message = can.Message
        self._unpack = msgpack.unpackb
        self._takes_fd = bus.protocol is can.CanProtocol.CAN_FD
        self._socket = socket.socket(fileno=os.dup(bus.fileno()))
        self._fd = self._socket.fileno()
        self._space = socket.CMSG_SPACE(_TIME.size)

    def fileno(self) -> int:
        """The socket's file descriptor."""
        return self._fd

    def close(self) -> None:
        """Receive nothing more; the bus itself stays open."""
        self._socket.close()

    def recv(self, timeout: float | None) -> can.Message | None:
        """The next frame, waited for at most so long (s); None when none came.

        Passed over: what is no frame, FD frames where they are not wanted, and remote frames, ours
        and others', which nobody here answers.

        Raises
        ------
        OSError
            When the network is gone.
        """
        left = timeout or 0.0
        until = time.monotonic() + left
        for _ in range(_MOST_PASSED_OVER):
            try:
                # our own frame is there as soon as it is sent
                found = self._socket.recvmsg(_LONGEST, self._space, socket.MSG_DONTWAIT)
            except BlockingIOError:
                if not is_there(self._fd, left):
                    return None
                left = 0.0
                continue
            if (frame := self._frame(found[0], found[1])) is not None:
                return frame
            left = max(0.0, until - time.monotonic())
            if not is_there(self._fd, left):
                return None
        return None

    def _frame(self, data: bytes, more: list[tuple[int, int, bytes]]) -> can.Message | None:
        """The frame in a datagram; None when it is none, or a request, ours or another's."""
        if len(data) < _CLASSIC and _REMOTE in data:
            return None
        try:
            fields = self._unpack(data)
            if fields["is_remote_frame"] or (fields["is_fd"] and not self._takes_fd):
                return None
            fields["timestamp"] = _stamp(more)
            return self._message(**fields)
        except Exception:  # noqa: BLE001 - whatever somebody else sent to the group, it is no frame
            return None


def _stamp(more: list[tuple[int, int, bytes]]) -> float:
    """When the kernel took a datagram in (CLOCK_REALTIME, s); 0 where it does not say."""
    for level, kind, data in more:
        if level == socket.SOL_SOCKET and kind == _TIMESTAMP:
            seconds, nanoseconds = _TIME.unpack(data)
            return float(seconds + nanoseconds * 1e-9)
    return 0.0
