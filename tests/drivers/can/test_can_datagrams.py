"""Frames from udp_multicast's socket: what python-can itself makes of them, and no garbage."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing

import can
import msgpack
import pytest
from can_links import free_port

from drivers.can.datagrams import Datagrams

GROUP = "239.74.163.85"
FRAMES = [
    can.Message(arbitration_id=0x123, data=b"\x01\x02", is_extended_id=False),
    can.Message(arbitration_id=0x18FF0012, data=bytes(8)),
    can.Message(arbitration_id=0x04, data=b"\x00\x10", is_error_frame=True, is_extended_id=False),
]
REMOTE = can.Message(arbitration_id=0x204, is_extended_id=False, is_remote_frame=True, dlc=4)
FD = can.Message(arbitration_id=5, data=bytes(range(48)), is_fd=True, bitrate_switch=True)


class Group:
    """A bus that sends, one that python-can receives from, and one that `Datagrams` does."""

    def __init__(self, stack: ExitStack, *, fd: bool) -> None:
        self.port = free_port()
        buses = [stack.enter_context(self._bus(fd=True)) for _ in range(2)]
        self.sender, self.reference = buses
        self.datagrams = Datagrams(stack.enter_context(self._bus(fd=fd)))
        stack.enter_context(closing(self.datagrams))

    def _bus(self, *, fd: bool) -> can.BusABC:
        return can.Bus(
            interface="udp_multicast",
            channel=GROUP,
            port=self.port,
            hop_limit=0,
            fd=fd,
            ignore_config=True,
        )

    def throw(self, data: bytes) -> None:
        """Send something to the group that need not be a frame."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            other.sendto(data, (GROUP, self.port))


@pytest.fixture(params=[True, False], ids=["fd", "classic"])
def group(request: pytest.FixtureRequest) -> Iterator[Group]:
    with ExitStack() as stack:
        yield Group(stack, fd=request.param)


def test_frames_are_those_that_python_can_receives(group: Group) -> None:
    for sent in FRAMES:
        group.sender.send(sent)
        got, expected = group.datagrams.recv(30.0), group.reference.recv(30.0)
        assert got is not None
        assert expected is not None
        assert got.equals(expected, timestamp_delta=10.0)
        assert got.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
        assert abs(got.timestamp - time.time()) < 30.0
    assert group.datagrams.recv(0.0) is None


@pytest.mark.parametrize("fd", [True, False])
def test_fd_frames_only_where_they_are_wanted(*, fd: bool) -> None:
    with ExitStack() as stack:
        group = Group(stack, fd=fd)
        group.sender.send(FD)
        group.sender.send(FRAMES[0])
        for expected in [FD, FRAMES[0]] if fd else [FRAMES[0]]:
            got = group.datagrams.recv(30.0)
            assert got is not None
            assert got.equals(expected, timestamp_delta=None, check_channel=False)


def test_requests_are_passed_over(group: Group) -> None:
    group.sender.send(REMOTE)
    group.sender.send(FRAMES[0])
    got = group.datagrams.recv(30.0)
    assert got is not None
    assert got.arbitration_id == 0x123
    group.sender.send(REMOTE)
    assert group.datagrams.recv(0.02) is None


@pytest.mark.parametrize(
    "garbage",
    [b"", b"hello", msgpack.packb(7), msgpack.packb({"is_fd": False, "strange": 1}), b"\xc1" * 9],
)
def test_what_is_no_frame_is_passed_over(group: Group, garbage: bytes) -> None:
    group.throw(garbage)
    group.sender.send(FRAMES[0])
    got = group.datagrams.recv(30.0)
    assert got is not None
    assert got.arbitration_id == 0x123


def test_closing_leaves_the_bus_open() -> None:
    with ExitStack() as stack:
        group = Group(stack, fd=True)
        other = Datagrams(group.reference)
        other.close()
        group.sender.send(FRAMES[0])
        assert group.reference.recv(30.0) is not None
