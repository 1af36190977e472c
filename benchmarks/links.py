"""Sustained polling over serial lines and CAN: Abbe's links beside the bare libraries.

Each device is a simulated one in its own process; the bare library and the link take turns on it in
short rounds, so that whatever else the machine does strikes both. A *poll* is one read of all that
the row names, decoded. Reported are the medians over all rounds, of the ratio too: a host that is
slower for some rounds is so for both.
"""

from __future__ import annotations

import asyncio
import socket
import statistics
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from abbe.drivers.link import Link, link_class
from abbe.drivers.simulated.process import SimulatedProcess
from benchmarks.alternatives.bare_links import (
    AXES,
    DBC,
    NODES,
    POSITION,
    Bare,
    Poll,
    pyserial,
    remote_frame,
    sdo_uploads,
    settings,
    sync_and_pdos,
)
from benchmarks.measuring.report import machine, write_section

ROUNDS, POLLS = 40, 100
LIMIT = 1.2
"""Most that a link may cost, as a multiple of the bare library doing the same."""


class Row(NamedTuple):
    """One comparison.

    Attributes
    ----------
    what
        What is polled, over what.
    bare
        By which library, and how it waits.
    theirs, ours
        s per poll.
    ratio
        Ours as a multiple of theirs, round by round.
    """

    what: str
    bare: str
    theirs: float
    ours: float
    ratio: float


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


async def timed(poll: Poll) -> float:
    """Mean s per poll over one round."""
    await poll()
    began = time.perf_counter()
    for _ in range(POLLS):
        await poll()
    return (time.perf_counter() - began) / POLLS


async def side_by_side(
    bare: Bare, section: dict[str, Any], driver: str, names: tuple[str, ...]
) -> tuple[float, float, float]:
    """Median s per poll of the bare library and of the link, and median ratio of a round.

    Each is opened for its rounds and closed again: a serial port has one owner.
    """
    theirs, ours = [], []
    for _ in range(ROUNDS):
        with bare() as poll:
            theirs.append(await timed(poll))
        link = link_of(driver, section)
        await link.open()
        try:
            ours.append(await timed(polled(link, names)))
        finally:
            await link.close()
    ratios = [link / library for library, link in zip(theirs, ours, strict=True)]
    return statistics.median(theirs), statistics.median(ours), statistics.median(ratios)


async def serial_rows() -> list[Row]:
    """Polling a read-out over a pseudo-terminal."""
    rows = []
    with SimulatedProcess("serial", "dro") as dro:
        port = dro.ready["device"]
        section = {
            "port": port,
            "baudrate": 115200,
            "timeout": 1.0,
            "messages": {"position": {"query": "R", "pattern": POSITION}},
            "channels": {axis: {"message": "position"} for axis in AXES},
        }
        for how, bare in (
            ("`read_until`", pyserial(port, by_line=True, in_thread=False)),
            ("`in_waiting`, in a thread", pyserial(port, by_line=False, in_thread=True)),
            ("`in_waiting`, blocking", pyserial(port, by_line=False, in_thread=False)),
        ):
            times = await side_by_side(bare, section, "serial", AXES)
            rows.append(Row("query, pseudo-terminal", f"pyserial, {how}", *times))
    return rows


async def can_rows(ready: Mapping[str, Any]) -> list[Row]:
    """Polling a bus in three ways, against each way in which the libraries wait."""
    base = settings(ready) | {"timeout": 1.0}
    dbc = base | {
        "dbc": str(DBC),
        "messages": {"POSITION_Z": {"request": "remote"}},
        "channels": {"position_z": {"message": "POSITION_Z"}},
    }
    nodes = {axis: {"id": number} for axis, number in zip(AXES, NODES, strict=True)}
    encoder = {axis: {"node": axis, "profile": "cia406"} for axis in AXES}
    by_sdo = base | {"nodes": nodes, "channels": encoder}
    by_pdo = base | {
        "nodes": nodes,
        "channels": {axis: section | {"by": "pdo"} for axis, section in encoder.items()},
        "sync": "read",
    }
    name = ready["interface"]
    rows = []
    for notified, how in ((False, "blocking"), (True, "its asyncio notifier")):
        bare = remote_frame(ready, notified=notified)
        times = await side_by_side(bare, dbc, "can", ("position_z",))
        rows.append(Row(f"remote frame, {name}", f"python-can + cantools, {how}", *times))
        bare = sync_and_pdos(ready, notified=notified)
        times = await side_by_side(bare, by_pdo, "canopen", AXES)
        rows.append(Row(f"SYNC and 3 PDOs, {name}", f"python-can, {how}", *times))
    times = await side_by_side(sdo_uploads(ready), by_sdo, "canopen", AXES)
    rows.append(Row(f"3 SDO uploads, {name}", "canopen, its own thread", *times))
    return rows


def free_port() -> int:
    """A UDP port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port: int = probe.getsockname()[1]
        return port


async def measure() -> list[Row]:
    """All rows."""
    rows = await serial_rows()
    with SimulatedProcess("can") as bus:
        rows += await can_rows(bus.ready)
    with SimulatedProcess("can", "--udp", f"239.74.163.88:{free_port()}") as bus:
        rows += await can_rows(bus.ready)
    return rows


def page(rows: list[Row]) -> str:
    """The section of docs/performance.md."""
    lines = [
        "## Serial and CAN links",
        "",
        f"{machine()}. Sustained polling of simulated devices in their own process, over",
        "pseudo-terminals and loopback; a poll reads and decodes all that the row names. Medians",
        f"of {ROUNDS} rounds of {POLLS} polls, both in turn, also of the rounds' ratios.",
        f"`benchmarks/links.py`; no ratio may be above {LIMIT:g}, also where the library blocks a",
        "thread that it has for itself, which a service with several links cannot give it.",
        "",
        "| poll | compared to | its polls/s | link's polls/s | time, link ÷ it |",
        "| --- | --- | ---: | ---: | ---: |",
    ]
    lines += [
        f"| {row.what} | {row.bare} | {1 / row.theirs:,.0f} | {1 / row.ours:,.0f} | "
        f"{row.ratio:.2f} |"
        for row in rows
    ]
    return "\n".join(lines)


def main() -> None:
    """Measure, print, and write the section of docs/performance.md."""
    rows = asyncio.run(measure())
    text = page(rows)
    print(text)
    write_section("links", text)
    slow = [f"{r.what} ({r.bare})" for r in rows if r.ratio > LIMIT]
    if slow:
        sys.exit(f"slower than {LIMIT:g} times: {', '.join(slow)}")


if __name__ == "__main__":
    main()
