"""``python -m abbe.drivers.simulated bridge``: run it, measure it, print its registers."""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path as FilePath

from abbe.drivers.simulated.bridge.device import BridgeDevice
from abbe.drivers.simulated.bridge.machine import AXES, TOOL, make_bridge
from abbe.drivers.simulated.bridge.measure import KINDS, campaign
from abbe.drivers.simulated.bridge.plant import Disturbances, Plant, shop_climate
from abbe.drivers.simulated.bridge.registers import (
    BLOCKS,
    ENCODERS,
    UNIT_ID,
    register_map,
    transducer_configs,
)
from abbe.drivers.simulated.commands import OWN_FILE
from abbe.drivers.simulated.commands.point_argument import point
from abbe.drivers.simulated.modbus.server import SimulatedServer
from abbe.drivers.simulated.pseudo_terminals.pty_pair import PtyPair


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    options = _parser().parse_args(arguments)
    # pymodbus logs whatever a client does wrong; a server's log is its client's business.
    logging.getLogger("pymodbus_internal").setLevel(logging.CRITICAL)
    logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
    if options.command == "measure":
        return _measure(options)
    if options.command == "registers":
        sys.stdout.write(register_map())
        return 0
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        print(f"simulated bridge: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    commands = parser.add_subparsers(dest="command", required=True)

    bridge = commands.add_parser("bridge", help="serve a bridge CMM over Modbus")
    bridge.add_argument("--seed", type=int, default=1, help="which machine")
    bridge.add_argument("--host", default="127.0.0.1")
    bridge.add_argument("--port", type=int, default=0, help="TCP port; 0: any free one")
    bridge.add_argument("--rtu", action="store_true", help="RTU over a pseudo-terminal instead")
    bridge.add_argument("--serial-port", help="RTU over this serial port")
    bridge.add_argument("--baudrate", type=int, default=115200)
    bridge.add_argument(
        "--time-factor", type=float, default=1.0, help="shop seconds per second (temperatures)"
    )
    bridge.add_argument(
        "--noise", type=float, default=0.3, metavar="UM", help="repeatability, µm (default 0.3)"
    )
    bridge.add_argument(
        "--tool", type=point, default=TOOL, metavar="X,Y,Z", help="probe tip's offset, mm"
    )
    bridge.add_argument(
        "--stand-at", type=point, metavar="X,Y,Z", help="go there and stand instead of moving, mm"
    )
    bridge.add_argument(
        "--encoder-zero",
        type=_zero,
        action="append",
        default=[],
        metavar="AXIS=COUNTS",
        help="other count at position 0, e.g. Z=-2147483648 to wrap around in the travel",
    )
    bridge.add_argument(
        "--die-with-stdin", action="store_true", help="end when standard input ends"
    )

    measure = commands.add_parser("measure", help="write a measurement campaign of the machine")
    measure.add_argument("--seed", type=int, default=1, help="which machine")
    measure.add_argument("--kind", choices=KINDS, default="fit")
    measure.add_argument("-o", "--output", type=FilePath, help="file; default: standard output")

    commands.add_parser("registers", help="print the register map as Markdown")
    for name, what in OWN_FILE.items():
        commands.add_parser(name, help=f"serve {what}; see {name} --help")
    return parser


def _measure(options: argparse.Namespace) -> int:
    text = campaign(options.seed, options.kind)
    if options.output is None:
        sys.stdout.write(text)
        return 0
    output: FilePath = options.output
    unfinished = output.with_name(output.name + ".part")
    try:
        unfinished.write_text(text, encoding="utf-8")
        unfinished.replace(output)
    except OSError as error:
        print(f"cannot write {output}: {error.strerror}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


async def _serve(options: argparse.Namespace) -> None:
    encoders = {a: dict(e) for a, e in ENCODERS.items()}
    for axis, count in options.encoder_zero:
        encoders[axis]["zero"] = count
    disturbances = Disturbances(repeatability=options.noise * 1e-3)
    if options.stand_at is not None:
        disturbances.go_to, disturbances.target = True, options.stand_at
    plant = Plant(
        make_bridge(options.seed),
        shop_climate(options.seed),
        time.monotonic(),
        options.time_factor,
        options.seed,
        options.tool,
        encoders,
        disturbances=disturbances,
    )
    server = SimulatedServer(BridgeDevice(plant), UNIT_ID)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    if options.die_with_stdin:
        threading.Thread(target=_watch_stdin, args=(loop, stop), daemon=True).start()
    with ExitStack() as stack:
        try:
            where = await _listen(server, options, stack)
            ready = {
                "ready": True,
                **where,
                "unit": UNIT_ID,
                "pid": os.getpid(),
                "seed": options.seed,
                "tool": list(options.tool),
                "registers": [
                    {"block": block.name} | register.to_dict()
                    for block in BLOCKS
                    for register in block.registers
                ],
                "transducers": transducer_configs(encoders),
            }
            sys.stdout.write(json.dumps(ready) + "\n")
            sys.stdout.flush()
            await stop.wait()
        finally:
            await server.stop()


async def _listen(
    server: SimulatedServer, options: argparse.Namespace, stack: ExitStack
) -> dict[str, object]:
    """Serve on TCP or on a serial line, which `stack` closes; how a client gets there."""
    if not (options.rtu or options.serial_port):
        port = await server.start_tcp(options.host, options.port)
        return {"protocol": "tcp", "host": options.host, "port": port}
    near = far = options.serial_port
    if near is None:
        cable = PtyPair()
        stack.callback(cable.close)
        cable.start()
        near, far = cable.near, cable.far
    await server.start_rtu(near, options.baudrate)
    return {"protocol": "rtu", "device": far, "baudrate": options.baudrate}


def _watch_stdin(loop: asyncio.AbstractEventLoop, stop: asyncio.Event) -> None:
    """Set `stop` when standard input ends: the parent is gone."""
    # os.read holds no lock of sys.stdin, which would trouble the interpreter's end.
    while os.read(0, 4096):
        pass
    loop.call_soon_threadsafe(stop.set)


def _zero(text: str) -> tuple[str, int]:
    axis, _, count = text.partition("=")
    try:
        if axis not in AXES:
            raise ValueError
        return axis, int(count)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"found {text!r}; expected X, Y or Z, =, and a whole count"
        ) from None
