"""Polling by the bare libraries: pyserial, python-can with cantools, canopen.

Each function makes a context that opens a port or bus and hands out its *poll*: one read of all
that the row names, decoded. Blocking ones have their thread for themselves. A service cannot have
them, so beside them stands what the library offers to an asyncio program: python-can's own
`Notifier` and `AsyncBufferedReader`; pyserial, which has nothing, in a thread.
"""

from __future__ import annotations

import asyncio
import re
import struct
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import can
import canopen
import cantools
import serial

import abbe.drivers.simulated.can

AXES = ("x", "y", "z")
NODES = (3, 4, 5)
NUMBER = r"[-+][\d.]+"
POSITION = rf"X(?P<x>{NUMBER}) Y(?P<y>{NUMBER}) Z(?P<z>{NUMBER})"
DBC = Path(abbe.drivers.simulated.can.__file__).with_name("machine.dbc")

Poll = Callable[[], Awaitable[None]]
Bare = Callable[[], AbstractContextManager[Poll]]


def pyserial(port: str, *, by_line: bool, in_thread: bool) -> Bare:
    """Pyserial as its documentation has it (`read_until`), or reading all that is there."""
    pattern = re.compile(POSITION)

    @contextmanager
    def bare() -> Iterator[Poll]:
        with serial.Serial(port, 115200, timeout=1.0, exclusive=True) as line:

            def answer() -> bytes:
                if by_line:
                    return bytes(line.read_until(b"\r\n"))
                got = b""
                while not got.endswith(b"\r\n"):
                    got += line.read(line.in_waiting or 1)
                return got

            def blocking() -> None:
                line.write(b"R\r\n")
                found = pattern.fullmatch(answer().decode("latin-1").strip())
                assert found is not None
                for axis in AXES:
                    float(found[axis])

            async def poll() -> None:
                blocking()

            async def poll_in_thread() -> None:
                await asyncio.to_thread(blocking)

            yield poll_in_thread if in_thread else poll

    return bare


def settings(ready: Mapping[str, Any]) -> dict[str, Any]:
    """How python-can gets onto the simulated bus."""
    if ready["interface"] == "slcan":
        return {
            "interface": "slcan",
            "channel": ready["channel"],
            "bitrate": 500_000,
            "options": {"sleep_after_open": 0.0},
        }
    more = {"port": ready["port"], "hop_limit": 0, "fd": False}
    return {"interface": "udp_multicast", "channel": ready["channel"], "options": more}


@contextmanager
def _frames(
    ready: Mapping[str, Any], *, notified: bool
) -> Iterator[tuple[can.BusABC, Callable[[], Awaitable[can.Message | None]]]]:
    """An open bus and what gets its next frame."""
    section = settings(ready)
    options = section.pop("options")
    with can.Bus(ignore_config=True, **section, **options) as bus:
        if not notified:

            async def next_frame() -> can.Message | None:
                return bus.recv(1.0)

            yield bus, next_frame
            return
        reader = can.AsyncBufferedReader()
        notifier = can.Notifier(bus, [reader], loop=asyncio.get_running_loop())
        try:

            async def next_message() -> can.Message | None:
                return await asyncio.wait_for(reader.get_message(), 1.0)

            yield bus, next_message
        finally:
            notifier.stop()


def remote_frame(ready: Mapping[str, Any], *, notified: bool) -> Bare:
    """python-can and cantools: a remote frame, and the answer decoded."""
    message = cantools.database.load_file(DBC).get_message_by_name("POSITION_Z")

    @contextmanager
    def bare() -> Iterator[Poll]:
        with _frames(ready, notified=notified) as (bus, next_frame):
            request = can.Message(
                arbitration_id=message.frame_id, is_extended_id=False, is_remote_frame=True, dlc=4
            )

            async def poll() -> None:
                bus.send(request)
                while (got := await next_frame()) is not None:
                    if got.arbitration_id == message.frame_id and not got.is_remote_frame:
                        message.decode(got.data, decode_choices=False)
                        return
                raise TimeoutError

            yield poll

    return bare


def sync_and_pdos(ready: Mapping[str, Any], *, notified: bool) -> Bare:
    """python-can: SYNC, and the three PDOs that answer it."""

    @contextmanager
    def bare() -> Iterator[Poll]:
        with _frames(ready, notified=notified) as (bus, next_frame):
            for node in NODES:
                bus.send(can.Message(arbitration_id=0, data=[1, node], is_extended_id=False))
            request = can.Message(arbitration_id=0x80, is_extended_id=False)

            async def poll() -> None:
                bus.send(request)
                missing = {0x280 + node for node in NODES}
                while missing:
                    got = await next_frame()
                    if got is None:
                        raise TimeoutError
                    if got.arbitration_id in missing:
                        missing.discard(got.arbitration_id)
                        struct.unpack("<l", got.data)

            yield poll

    return bare


def sdo_uploads(ready: Mapping[str, Any]) -> Bare:
    """canopen: 6004h of the three encoders, one after the other."""

    @contextmanager
    def bare() -> Iterator[Poll]:
        section = settings(ready)
        options = section.pop("options")
        network = canopen.Network(can.Bus(ignore_config=True, **section, **options))
        network.connect()
        nodes = [network.add_node(number, canopen.ObjectDictionary()) for number in NODES]

        async def poll() -> None:
            for node in nodes:
                struct.unpack("<l", node.sdo.upload(0x6004, 0))

        try:
            yield poll
        finally:
            network.disconnect()

    return bare
