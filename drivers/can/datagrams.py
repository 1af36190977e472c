"""Frames over python-can's ``udp_multicast``, taken from its socket in one step each.

python-can waits, looks at the time, filters and checks anew for each frame, our own included, which
this interface gives back; that is half of what a request costs here. And where one datagram of the
group is no frame, its receiving fails. Here such a one is passed over.

Datagrams of one id from one sender differ in the time and in the data alone, and where these stand
follows from the bytes before them. So the rest is unpacked once and known from then on, as one
frame that is handed out with each one's time and data. A frame that is sent again and again, to ask
for something, is packed once.
"""

from __future__ import annotations

import os
import socket
import struct
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from abbe.drivers.reply_wait import is_there

if TYPE_CHECKING:
    import can

    from abbe.drivers.can.interface import InterfaceConfig

_LONGEST = 4096
"""Bytes; python-can's own limit."""
_MOST_PASSED_OVER = 64
"""Datagrams in a row."""
_TIME_AT = 12
"""Bytes before a datagram's time: python-can packs a map of eleven fields, that one first."""
_REST_AT = _TIME_AT + 8
"""Where the fields behind the time begin."""
_ONE = struct.pack(">d", 1.0)
_DATA = b"\xa4data\xc4"
"""What stands before the data: its key, and that one byte of length and so many bytes follow."""
_PORT = 43113
"""python-can's own, where the options name none."""
_MOST_PACKED = 64
"""Frames that are remembered as they are sent."""
_MOST_KNOWN = 4096
"""Kinds of datagrams that are remembered: twice as many as there are 11-bit ids."""
_TIME = struct.Struct("@ll")
_TIMESTAMP = 35
"""SO_TIMESTAMPNS, which python-can has switched on: seconds and nanoseconds at arrival."""


class Datagrams:
    """Sender and receiver in place of an open ``udp_multicast`` bus.

    Parameters
    ----------
    bus
        python-can's.
    group
        The address and port of its multicast group.
    """

    def __init__(self, bus: can.BusABC, group: tuple[str, int]) -> None:
        import can
        import msgpack
        from can.interfaces.udp_multicast.utils import pack_message

        self._bus = bus
        self._group = group
        self._pack = pack_message
        self._packed: dict[can.Message, bytes] = {}

        self._message = can.Message
        self._unpack = msgpack.unpackb
        self._takes_fd = bus.protocol is can.CanProtocol.CAN_FD
        self._socket = socket.socket(fileno=os.dup(bus.fileno()))
        self._fd = self._socket.fileno()
        self._space = socket.CMSG_SPACE(_TIME.size)
        self._known: dict[tuple[bytes, bytes, bytes], can.Message | None] = {}
        """What stands before the time, before the data and behind it → the frame that gets time and
        data; None for one that is passed over."""

    def fileno(self) -> int:
        """The socket's file descriptor."""
        return self._fd

    def close(self) -> None:
        """Receive nothing more; the bus itself stays open."""
        self._socket.close()

    def recv(self, timeout: float | None) -> can.Message | None:
        """The next frame, waited for at most so long (s); None when none came.

        It holds until the next call: the next frame of its kind is the same object.

        Passed over: what is no frame, FD frames where they are not wanted, and remote frames, ours
        and others', which nobody here answers.

        Raises
        ------
        OSError
            When the network is gone.
        """
        left = timeout or 0.0
        until = time.monotonic() + left if left else 0.0
        for _ in range(_MOST_PASSED_OVER):
            try:
                # our own frame is there as soon as it is sent
                found = self._socket.recvmsg(_LONGEST, self._space, socket.MSG_DONTWAIT)
            except BlockingIOError:
                if left <= 0.0 or not is_there(self._fd, left):
                    return None
                left = 0.0
                continue
            if (frame := self._frame(found[0], found[1])) is not None:
                return frame
            if until:
                left = until - time.monotonic()
                if not is_there(self._fd, max(0.0, left)):
                    return None
        return None

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        """Send a frame, which is not changed afterwards; without waiting.

        Raises
        ------
        OSError, can.CanError
            When it does not go out.
        """
        if message.is_fd:
            self._bus.send(message, timeout)
            return
        data = self._packed.get(message)
        if data is None:
            if len(self._packed) >= _MOST_PACKED:
                self._packed.clear()
            data = self._packed[message] = self._pack(message)
        self._socket.sendto(data, socket.MSG_DONTWAIT, self._group)

    def _frame(self, data: bytes, more: list[tuple[int, int, bytes]]) -> can.Message | None:
        """The frame in a datagram; None when it is none, or a request, ours or another's."""
        try:
            begin, end = _where_data_is(data)
            frame = self._known[data[:_TIME_AT], data[_REST_AT:begin], data[end:]]
        except (ValueError, IndexError, KeyError):
            return self._unpacked(data, _stamp(more))
        if frame is None or end > len(data):
            return None
        frame.timestamp = _stamp(more)
        frame.data = bytearray(data[begin:end])
        return frame

    def _unpacked(self, data: bytes, timestamp: float) -> can.Message | None:
        """The frame in a datagram of a kind that did not come yet, which is remembered."""
        try:
            fields = self._unpack(data)
            frame = self._message(**fields | {"timestamp": timestamp}, check=True)
        except Exception:  # noqa: BLE001 - whatever somebody else sent to the group, it is no frame
            return None
        passed_over = frame.is_remote_frame or (frame.is_fd and not self._takes_fd)
        found = None if passed_over else frame
        with suppress(Exception):  # not as python-can lays them out: never what ends a connection
            self._learn(data, fields, found)
        return found

    def _learn(self, data: bytes, fields: dict[str, Any], frame: can.Message | None) -> None:
        """Remember what becomes of datagrams like this one, where only time and data can differ."""
        begin, end = _where_data_is(data)
        other = bytes(0xFF ^ byte for byte in data[begin:end])
        changed = data[:_TIME_AT] + _ONE + data[_REST_AT:begin] + other + data[end:]
        if self._unpack(changed) != fields | {"timestamp": 1.0, "data": other}:
            return
        if len(self._known) >= _MOST_KNOWN:
            self._known.clear()
        self._known[data[:_TIME_AT], data[_REST_AT:begin], data[end:]] = frame


def group_of(config: InterfaceConfig) -> tuple[str, int]:
    """The address and port of a ``udp_multicast`` interface's group."""
    return str(config.channel), int(config.options.get("port", _PORT))


def _where_data_is(data: bytes) -> tuple[int, int]:
    """Where in a datagram the data begins and ends; raises ValueError, IndexError without it."""
    begin = data.index(_DATA, _REST_AT) + len(_DATA) + 1
    return begin, begin + data[begin - 1]


def _stamp(more: list[tuple[int, int, bytes]]) -> float:
    """When the kernel took a datagram in (CLOCK_REALTIME, s); 0 where it does not say."""
    for level, kind, data in more:
        if level == socket.SOL_SOCKET and kind == _TIMESTAMP:
            seconds, nanoseconds = _TIME.unpack(data)
            return float(seconds + nanoseconds * 1e-9)
    return 0.0
