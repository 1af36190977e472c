"""Frames from udp_multicast's socket: what python-can itself makes of them, and no garbage."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from inspect import signature

import can
import msgpack
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.drivers.can.datagrams import Datagrams, group_of
from abbe.drivers.can.interface import InterfaceConfig
from tests.support.drivers.can.links import free_port

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
        self.datagrams = Datagrams(stack.enter_context(self._bus(fd=fd)), (GROUP, self.port))
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


def test_frames_are_sent_as_python_can_sends_them(group: Group) -> None:
    """Also those that are sent again and again, and FD frames, which a classic bus refuses."""
    wanted = [*FRAMES, REMOTE, FRAMES[0], REMOTE]
    for frame in wanted:
        group.datagrams.send(frame)
        got = group.reference.recv(30.0)
        assert got is not None
        assert got.equals(frame, timestamp_delta=None, check_channel=False, check_direction=False)
    for number in range(200):
        group.datagrams.send(can.Message(arbitration_id=number, is_extended_id=False))
        got = group.reference.recv(30.0)
        assert got is not None
        assert got.arbitration_id == number


@pytest.mark.parametrize("fd", [True, False])
def test_fd_frames_are_sent_only_over_fd_buses(*, fd: bool) -> None:
    with ExitStack() as stack:
        group = Group(stack, fd=fd)
        if not fd:
            with pytest.raises(can.CanOperationError, match="FD"):
                group.datagrams.send(FD)
            return
        group.datagrams.send(FD)
        got = group.reference.recv(30.0)
        assert got is not None
        assert got.equals(FD, timestamp_delta=None, check_channel=False)


def packed(frame: can.Message, **other: object) -> bytes:
    """A frame as python-can sends it, or with other fields."""
    return bytes(msgpack.packb(msgpack.unpackb(pack_message(frame)) | other))


KINDS = [
    *map(packed, [*FRAMES, REMOTE, FD]),
    packed(FRAMES[0], channel="can0"),
    packed(FRAMES[0], channel=b"\xa4data\xc4\x02ab"),  # what looks like the data
    packed(FRAMES[0], channel={"data": b"\x01\x02"}),
    packed(FRAMES[0], timestamp=12.5),
    packed(FRAMES[0], timestamp=7),
    packed(FRAMES[0], data=[1, 2]),
    msgpack.packb({"data": b"ab", "dlc": 2, "arbitration_id": 5, "is_fd": False}),
]


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A datagram of a known kind, some of whose bytes are others, or lost, or too many."""
    data = bytearray(draw(st.sampled_from(KINDS)))
    for _ in range(draw(st.integers(0, 3))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    if draw(st.booleans()):
        return bytes(data[: draw(st.integers(0, len(data)))]) + draw(st.binary(max_size=4))
    return bytes(data)


@given(st.lists(damaged(), max_size=8))
@settings(max_examples=200)
def test_what_is_known_changes_nothing(datagrams: list[bytes]) -> None:
    """Who has seen many kinds of datagrams takes each for what who sees it first does."""
    with ExitStack() as stack:
        port = free_port()
        bus = stack.enter_context(
            can.Bus(interface="udp_multicast", channel=GROUP, port=port, ignore_config=True)
        )
        old = stack.enter_context(closing(Datagrams(bus, (GROUP, port))))
        for data in [*KINDS, *datagrams, *datagrams]:
            new = stack.enter_context(closing(Datagrams(bus, (GROUP, port))))
            expected = new._frame(data, [])
            got = old._frame(data, [])
            assert (got is None) is (expected is None)
            if got is not None and expected is not None:
                assert got.equals(expected, timestamp_delta=None)


def test_kinds_that_are_frames_are_taken() -> None:
    """So that the comparison above compares something; FD frames are wanted here."""
    with ExitStack() as stack:
        group = Group(stack, fd=True)
        for kind in KINDS:
            group.throw(kind)
            wanted = kind != packed(REMOTE)
            assert (group.datagrams.recv(30.0 if wanted else 0.02) is not None) is wanted


def test_the_port_is_python_cans_own_where_none_is_named() -> None:
    config = InterfaceConfig(interface="udp_multicast", channel=GROUP)
    own = signature(UdpMulticastBus.__init__).parameters["port"].default
    assert group_of(config) == (GROUP, own)
    named = config.model_copy(update={"options": {"port": 5000}})
    assert group_of(named) == (GROUP, 5000)


def test_closing_leaves_the_bus_open() -> None:
    with ExitStack() as stack:
        group = Group(stack, fd=True)
        other = Datagrams(group.reference, (GROUP, group.port))
        other.close()
        group.sender.send(FRAMES[0])
        assert group.reference.recv(30.0) is not None
