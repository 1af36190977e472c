"""``python -m abbe.drivers.simulated serial``: ASCII devices and a tape reader."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import sys
import tempfile
import time
from collections.abc import Coroutine, Sequence
from pathlib import Path
from typing import NamedTuple

from abbe.drivers.simulated.controller.tape_reader import TapeReader
from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort
from abbe.drivers.simulated.remote_control import Orders, announce, serve_orders
from abbe.drivers.simulated.serial.devices import (
    AsciiDevice,
    LineServer,
    ReadOut,
    ThermometerModules,
)

KINDS = ("dro", "thermometer", "tape")


class _Made(NamedTuple):
    port: PtyPort
    orders: Orders
    work: list[Coroutine[None, None, None]]


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns the exit status."""
    options = _parser().parse_args(arguments)
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        print(f"simulated {options.kind}: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    parser.add_argument("command", choices=("serial",))
    parser.add_argument("kind", choices=KINDS, help="which device")
    parser.add_argument(
        "--link", type=Path, help="path that always leads to the port; default: any"
    )
    parser.add_argument(
        "--baudrate", type=int, default=0, help="pace of the line; 0: as fast as the machine"
    )
    parser.add_argument(
        "--stream", type=float, metavar="HZ", help="send by itself so often instead of answering"
    )
    parser.add_argument("--checksum", action="store_true", help="lines end in * and their xor")
    parser.add_argument("--speed", type=float, default=0.05, help="turns/s of the read-out's axes")
    parser.add_argument(
        "--verify", choices=("none", "echo", "checksum"), default="none", help="tape: how"
    )
    parser.add_argument(
        "--rate", type=float, default=2000.0, help="tape: characters taken a second"
    )
    parser.add_argument("--buffer", type=int, default=64, help="tape: characters that fit in")
    parser.add_argument(
        "--die-with-stdin", action="store_true", help="take orders there, end when it ends"
    )
    return parser


async def _serve(options: argparse.Namespace) -> None:
    """Serve one device until told to end."""
    with contextlib.ExitStack() as stack:
        link: Path | None = options.link
        if link is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="abbe-serial-"))
            link = Path(folder) / options.kind
        # Ten bits a character: 8N1.
        character_time = 10.0 / options.baudrate if options.baudrate else 0.0
        make = _tape if options.kind == "tape" else _lines
        port, orders, work = make(options, link, character_time)
        port.plug()
        stack.callback(port.unplug)
        tasks = [asyncio.ensure_future(job) for job in work]
        announce(
            ready=True, protocol="serial", device=str(link), kind=options.kind, pid=os.getpid()
        )
        try:
            await serve_orders(orders, die_with_stdin=options.die_with_stdin)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


def _plugging(port: PtyPort) -> Orders:
    return {"unplug": port.unplug, "plug": port.plug}


def _lines(options: argparse.Namespace, link: Path, character_time: float) -> _Made:
    device: AsciiDevice = ReadOut(options.speed) if options.kind == "dro" else ThermometerModules()
    loop = asyncio.get_running_loop()
    server = LineServer(
        device, lambda data: port.send(data), loop.call_later, checksum=options.checksum
    )
    port = PtyPort(link, server.receive, character_time)
    faults = server.faults

    async def stream() -> None:
        while True:
            server.stream()
            await asyncio.sleep(1.0 / options.stream)

    def fault(
        *,
        late: int = 0,
        lateness: float = 0.0,
        garbled: int = 0,
        cut: int = 0,
        echo: bool = False,
    ) -> None:
        faults.late, faults.lateness = late, lateness
        faults.garbled, faults.cut, faults.echo = garbled, cut, echo

    def silent(seconds: float) -> None:
        faults.silent_until = time.monotonic() + seconds

    def dead(addresses: list[int]) -> None:
        if isinstance(device, ThermometerModules):
            device.dead = set(addresses)

    def temperature(address: int, values: list[float]) -> None:
        if isinstance(device, ThermometerModules):
            device.temperatures[address] = values

    orders: Orders = {
        **_plugging(port),
        "silent": silent,
        "fault": fault,
        "say": lambda text: port.send(text.encode("latin-1")),
        "queries": lambda: {"queries": server.queries},
        "dead": dead,
        "temperature": temperature,
    }
    return _Made(port, orders, [stream()] if options.stream else [])


def _tape(options: argparse.Namespace, link: Path, character_time: float) -> _Made:
    reader = TapeReader(lambda data: port.send(data), options.rate, options.buffer, options.verify)
    port = PtyPort(link, reader.receive)
    jobs: set[asyncio.Task[None]] = set()

    def punch() -> None:
        job = asyncio.get_running_loop().create_task(reader.punch(character_time))
        jobs.add(job)
        job.add_done_callback(jobs.discard)

    def plug() -> None:
        reader.renew()
        port.plug()

    def fault(
        *, stalled: bool = False, corrupt: int | None = None, break_after: int | None = None
    ) -> None:
        reader.stalled, reader.corrupt, reader.break_after = stalled, corrupt, break_after

    reader.on_break = port.unplug
    orders: Orders = {
        **_plugging(port),
        "plug": plug,
        "read": reader.read,
        "punch": punch,
        "alarm": reader.alarm,
        "fault": fault,
        "report": reader.report,
    }
    return _Made(port, orders, [reader.work()])
