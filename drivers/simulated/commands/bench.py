"""``python -m abbe.drivers.simulated bench``: the bridge CMM with a laser beside it, and a program.

The machine is served over Modbus TCP, the laser over a pseudo-terminal; orders on standard input
(`abbe.drivers.simulated.remote_control`) drive the machine through a program's moves, place the
laser, break its beam.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from abbe.drivers.simulated.bridge.device import BridgeDevice
from abbe.drivers.simulated.bridge.laser import Optics, SimulatedLaser
from abbe.drivers.simulated.bridge.machine import AXES, TOOL, make_bridge
from abbe.drivers.simulated.bridge.plant import Disturbances, Plant, shop_climate
from abbe.drivers.simulated.bridge.program_runner import ProgramRunner
from abbe.drivers.simulated.bridge.registers import BLOCKS, UNIT_ID, transducer_configs
from abbe.drivers.simulated.commands.point_argument import point
from abbe.drivers.simulated.modbus.server import SimulatedServer
from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort
from abbe.drivers.simulated.remote_control import announce, serve_orders
from abbe.drivers.simulated.serial.devices import LineServer


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns the exit status."""
    options = _parser().parse_args(arguments)
    logging.getLogger("pymodbus_internal").setLevel(logging.CRITICAL)
    logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        print(f"simulated bench: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    parser.add_argument("command", choices=("bench",))
    parser.add_argument("--seed", type=int, default=1, help="which machine")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=0, help="TCP port; 0: any free one")
    parser.add_argument(
        "--time-factor", type=float, default=1.0, help="shop seconds per second (temperatures)"
    )
    parser.add_argument(
        "--noise", type=float, default=0.3, metavar="UM", help="repeatability, µm (default 0.3)"
    )
    parser.add_argument(
        "--tool", type=point, default=TOOL, metavar="X,Y,Z", help="probe tip's offset, mm"
    )
    parser.add_argument(
        "--stand-at", type=point, default=(10.0, 10.0, -10.0), metavar="X,Y,Z", help="begin, mm"
    )
    parser.add_argument("--link", type=Path, help="path that leads to the laser; default: any")
    parser.add_argument(
        "--stream", type=float, metavar="HZ", default=0.0, help="laser: send so often by itself"
    )
    parser.add_argument(
        "--die-with-stdin", action="store_true", help="take orders there, end when it ends"
    )
    return parser


async def _serve(options: argparse.Namespace) -> None:
    disturbances = Disturbances(
        repeatability=options.noise * 1e-3, go_to=True, target=options.stand_at
    )
    plant = Plant(
        make_bridge(options.seed),
        shop_climate(options.seed),
        time.monotonic(),
        options.time_factor,
        options.seed,
        options.tool,
        disturbances=disturbances,
    )
    laser = SimulatedLaser(plant, options.seed)
    device = BridgeDevice(plant)
    server = SimulatedServer(device, UNIT_ID)
    runner = ProgramRunner(plant, laser)
    with contextlib.ExitStack() as stack:
        link: Path | None = options.link
        if link is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="abbe-laser-"))
            link = Path(folder) / "laser"
        loop = asyncio.get_running_loop()
        lines = LineServer(laser, lambda data: port.send(data), loop.call_later)
        port = PtyPort(link, lines.receive)
        port.plug()
        stack.callback(port.unplug)
        number = await server.start_tcp(options.host, options.port)
        streaming = asyncio.ensure_future(_stream(lines, options.stream))
        announce(
            ready=True,
            protocol="tcp",
            host=options.host,
            port=number,
            unit=UNIT_ID,
            pid=os.getpid(),
            seed=options.seed,
            tool=list(options.tool),
            laser=str(link),
            registers=[
                {"block": block.name} | register.to_dict()
                for block in BLOCKS
                for register in block.registers
            ],
            transducers=transducer_configs(),
        )
        try:
            orders = _orders(runner, laser, lines, port) | {
                "written": lambda: {"written": device.written}
            }
            await serve_orders(orders, die_with_stdin=options.die_with_stdin)
        finally:
            streaming.cancel()
            runner.stop()
            await asyncio.gather(streaming, return_exceptions=True)
            await server.stop()


async def _stream(lines: LineServer, often: float) -> None:
    while often:
        lines.stream()
        await asyncio.sleep(1.0 / often)


def _orders(
    runner: ProgramRunner, laser: SimulatedLaser, lines: LineServer, port: PtyPort
) -> dict[str, Any]:
    wrong = runner.plant.disturbances

    def silent(seconds: float) -> None:
        lines.faults.silent_until = time.monotonic() + seconds

    def restart(seconds: float) -> None:
        laser.reset()
        silent(seconds)

    def truth(points: list[list[float]], tool: list[float]) -> dict[str, Any]:
        """The exact error at indicated positions with the present temperatures, mm."""
        plant = runner.plant
        now = plant.latch(time.monotonic()).temperatures
        return {"errors": [plant.machine.error(p, now, tool).tolist() for p in points]}

    return {
        "drive": runner.drive,
        "where": runner.where,
        "stop": runner.stop,
        "place": lambda **optics: laser.place(Optics(**optics)),
        "beam": lambda broken: laser.break_beam(broken=broken),
        "restart": restart,
        "reset": laser.reset,
        "slip": laser.slip,
        "factor": lambda by: setattr(laser, "factor", by),
        "silent": silent,
        "unplug": port.unplug,
        "plug": port.plug,
        "thermistors": lambda lost: setattr(wrong, "thermistors_open", lost),
        "shop": runner.plant.pass_shop_time,
        "truth": truth,
        "axes": lambda: {"axes": list(AXES)},
    }
