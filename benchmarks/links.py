"""Sustained polling over serial lines and CAN: Abbe's links beside the bare libraries.

Each device is a simulated one in its own process; the bare library and the link take turns on it in
short rounds, so that whatever else the machine does strikes both. A *poll* is one read of all three
axes, decoded. Reported are the medians over all rounds.
"""

from __future__ import annotations

import asyncio
import re
import statistics
import struct
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import canopen
import cantools
import serial

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import drivers.simulated
from benchmarks.report import machine, write_section
from drivers.link import Link, link_class
from drivers.simulated.process import SimulatedProcess

ROUNDS, POLLS = 30, 60
AXES = ("x", "y", "z")
NODES = (3, 4, 5)
LIMIT = 1.2
"""Most that a link may cost, as a multiple of the bare library."""
NUMBER = r"[-+][\d.]+"
POSITION = rf"X(?P<x>{NUMBER}) Y(?P<y>{NUMBER}) Z(?P<z>{NUMBER})"
DBC = Path(drivers.simulated.__file__).with_name("machine.dbc")

Poll = Callable[[], Awaitable[None]]


def link_of(driver: str, section: dict[str, Any]) -> Link:
    """A link as the service makes it."""
    kind = link_class(driver)
    return kind("bench", kind.Config.model_validate(section))


def polled(link: Link, names: tuple[str, ...]) -> Poll:
    """One read of a link, which must be good."""

    async def poll() -> None:
        samples = await link.read(names)
        for name in names:
            assert samples[name].good, samples[name].reason

    return poll


async def side_by_side(
    bare: Callable[[], Any], section: dict[str, Any], driver: str, names: tuple[str, ...]
) -> tuple[float, float]:
    """Median s per poll of the bare library and of the link.

    Each is opened for its rounds and closed again: a serial port has one owner.
    """
    theirs, ours = [], []
    for _ in range(ROUNDS):
        with bare() as poll_bare:
            poll_bare()
            began = time.perf_counter()
            for _ in range(POLLS):
                poll_bare()
            theirs.append((time.perf_counter() - began) / POLLS)
        link = link_of(driver, section)
        await link.open()
        try:
            poll = polled(link, names)
            await poll()
            began = time.perf_counter()
            for _ in range(POLLS):
                await poll()
            ours.append((time.perf_counter() - began) / POLLS)
        finally:
            await link.close()
    return statistics.median(theirs), statistics.median(ours)


# Serial


def pyserial_lines(port: str, *, by_line: bool) -> Callable[[], Any]:
    """Pyserial as its documentation has it (`read_until`), or reading all that is there."""
    pattern = re.compile(POSITION)

    @contextmanager
    def bare() -> Iterator[Callable[[], None]]:
        with serial.Serial(port, 115200, timeout=1.0, exclusive=True) as line:

            def answer() -> bytes:
                if by_line:
                    return bytes(line.read_until(b"\r\n"))
                got = b""
                while not got.endswith(b"\r\n"):
                    got += line.read(line.in_waiting or 1)
                return got

            def poll() -> None:
                line.write(b"R\r\n")
                found = pattern.fullmatch(answer().decode("latin-1").strip())
                assert found is not None
                for axis in AXES:
                    float(found[axis])

            yield poll

    return bare


async def serial_rows() -> list[tuple[str, float, float]]:
    """Polling a read-out over a pseudo-terminal."""
    with SimulatedProcess("serial", "dro") as dro:
        port = dro.ready["device"]
        section = {
            "port": port,
            "baudrate": 115200,
            "timeout": 1.0,
            "messages": {"position": {"query": "R", "pattern": POSITION}},
            "channels": {axis: {"message": "position"} for axis in AXES},
        }
        rows = []
        for by_line, how in ((True, "pyserial, `read_until`"), (False, "pyserial, `in_waiting`")):
            bare = pyserial_lines(port, by_line=by_line)
            rows.append((how, *await side_by_side(bare, section, "serial", AXES)))
        return rows


# CAN


def settings(ready: dict[str, Any]) -> dict[str, Any]:
    """How python-can gets onto the simulated bus."""
    if ready["interface"] == "slcan":
        more: dict[str, Any] = {"sleep_after_open": 0.0}
        return {
            "interface": "slcan",
            "channel": ready["channel"],
            "bitrate": 500_000,
            "options": more,
        }
    more = {"port": ready["port"], "hop_limit": 0, "fd": False}
    return {"interface": "udp_multicast", "channel": ready["channel"], "options": more}


def open_bare(ready: dict[str, Any]) -> can.BusABC:
    """The bare interface."""
    section = settings(ready)
    options = section.pop("options")
    return can.Bus(ignore_config=True, **section, **options)


def bare_remote(ready: dict[str, Any]) -> Callable[[], Any]:
    """python-can and cantools: a remote frame, and the answer decoded."""
    message = cantools.database.load_file(DBC).get_message_by_name("POSITION_Z")

    @contextmanager
    def bare() -> Iterator[Callable[[], None]]:
        with open_bare(ready) as bus:
            request = can.Message(
                arbitration_id=message.frame_id, is_extended_id=False, is_remote_frame=True, dlc=4
            )

            def poll() -> None:
                bus.send(request)
                while (got := bus.recv(1.0)) is not None:
                    if got.arbitration_id == message.frame_id and not got.is_remote_frame:
                        message.decode(got.data, decode_choices=False)
                        return
                raise TimeoutError

            yield poll

    return bare


def bare_sync(ready: dict[str, Any]) -> Callable[[], Any]:
    """python-can: SYNC, and the three PDOs that answer it."""

    @contextmanager
    def bare() -> Iterator[Callable[[], None]]:
        with open_bare(ready) as bus:
            for node in NODES:
                bus.send(can.Message(arbitration_id=0, data=[1, node], is_extended_id=False))
            request = can.Message(arbitration_id=0x80, is_extended_id=False)

            def poll() -> None:
                bus.send(request)
                missing = {0x280 + node for node in NODES}
                while missing:
                    got = bus.recv(1.0)
                    if got is None:
                        raise TimeoutError
                    if got.arbitration_id in missing:
                        missing.discard(got.arbitration_id)
                        struct.unpack("<l", got.data)

            yield poll

    return bare


def bare_sdo(ready: dict[str, Any]) -> Callable[[], Any]:
    """canopen: 6004h of the three encoders, one after the other."""

    @contextmanager
    def bare() -> Iterator[Callable[[], None]]:
        network = canopen.Network(open_bare(ready))
        network.connect()
        nodes = [network.add_node(number, canopen.ObjectDictionary()) for number in NODES]

        def poll() -> None:
            for node in nodes:
                struct.unpack("<l", node.sdo.upload(0x6004, 0))

        try:
            yield poll
        finally:
            network.disconnect()

    return bare


async def can_rows(ready: dict[str, Any]) -> list[tuple[str, float, float]]:
    """Polling a bus in three ways."""
    base = settings(ready) | {"timeout": 1.0}
    dbc = base | {
        "dbc": str(DBC),
        "messages": {"POSITION_Z": {"request": "remote"}},
        "channels": {"position_z": {"message": "POSITION_Z"}},
    }
    nodes = {axis: {"id": number} for axis, number in zip(AXES, NODES, strict=True)}
    encoder = {axis: {"node": axis, "profile": "cia406"} for axis in AXES}
    by_pdo = {axis: section | {"by": "pdo"} for axis, section in encoder.items()}
    name = ready["interface"]
    return [
        (
            f"python-can + cantools, remote frame, {name}",
            *await side_by_side(bare_remote(ready), dbc, "can", ("position_z",)),
        ),
        (
            f"python-can, SYNC and 3 PDOs, {name}",
            *await side_by_side(
                bare_sync(ready),
                base | {"nodes": nodes, "channels": by_pdo, "sync": "read"},
                "canopen",
                AXES,
            ),
        ),
        (
            f"canopen, 3 SDO uploads, {name}",
            *await side_by_side(
                bare_sdo(ready), base | {"nodes": nodes, "channels": encoder}, "canopen", AXES
            ),
        ),
    ]


def free_port() -> int:
    """A UDP port that nobody has."""
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port: int = probe.getsockname()[1]
        return port


async def measure() -> list[tuple[str, float, float]]:
    """All rows: what the link is compared to, s per poll of it, s per poll of the link."""
    rows = await serial_rows()
    with SimulatedProcess("can") as bus:
        rows += await can_rows(bus.ready)
    with SimulatedProcess("can", "--udp", f"239.74.163.88:{free_port()}") as bus:
        rows += await can_rows(bus.ready)
    return rows


def main() -> None:
    """Measure, print, and write the section of docs/performance.md."""
    rows = asyncio.run(measure())
    lines = [
        "## Serial and CAN links",
        "",
        f"{machine()}. Sustained polling of simulated devices in their own process, over",
        "pseudo-terminals and loopback; a poll reads and decodes all that the row names. Medians",
        f"of {ROUNDS} rounds of {POLLS} polls, both in turn. `benchmarks/links.py`; no ratio may "
        f"be above {LIMIT:g}.",
        "",
        "| compared to | its polls/s | link's polls/s | time, link ÷ it |",
        "| --- | ---: | ---: | ---: |",
    ]
    for what, bare, ours in rows:
        lines.append(f"| {what} | {1 / bare:,.0f} | {1 / ours:,.0f} | {ours / bare:.2f} |")
    text = "\n".join(lines)
    print(text)
    write_section("links", text)
    slow = [what for what, bare, ours in rows if ours > LIMIT * bare]
    if slow:
        sys.exit(f"slower than {LIMIT:g} times: {', '.join(slow)}")


if __name__ == "__main__":
    main()
