"""``python -m abbe.drivers.simulated ipp``: the bridge CMM behind an I++ DME server."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from abbe.drivers.simulated.bridge.machine import TOOL, make_bridge
from abbe.drivers.simulated.bridge.plant import Disturbances, Plant, shop_climate
from abbe.drivers.simulated.commands.point_argument import point
from abbe.drivers.simulated.ipp.carrier import ProbeCarrier
from abbe.drivers.simulated.ipp.gauge import SimulatedGauge
from abbe.drivers.simulated.ipp.machine import COORDINATES, IppMachine
from abbe.drivers.simulated.ipp.rotary_table import SimulatedTable
from abbe.drivers.simulated.ipp.server import IppServer
from abbe.drivers.simulated.ipp.workpiece import SimulatedPlate
from abbe.drivers.simulated.remote_control import Orders, announce, serve_orders


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns the exit status."""
    options = _parser().parse_args(arguments)
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        print(f"simulated I++ DME server: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    parser.add_argument("command", choices=("ipp",))
    parser.add_argument("--seed", type=int, default=1, help="which machine")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=0, help="TCP port; 0: any free one")
    parser.add_argument(
        "--time-factor", type=float, default=1.0, help="shop seconds per second (temperatures)"
    )
    parser.add_argument(
        "--tool", type=point, default=TOOL, metavar="X,Y,Z", help="probe tip's offset, mm"
    )
    parser.add_argument(
        "--stand-at", type=point, metavar="X,Y,Z", help="go there and stand instead of moving, mm"
    )
    parser.add_argument("--rotary", action="store_true", help="with a rotary table")
    parser.add_argument(
        "--hurry", type=float, default=1.0, help="moves so many times faster than it is told"
    )
    parser.add_argument("--seats", type=int, default=1, help="clients at the same time")
    parser.add_argument(
        "--die-with-stdin", action="store_true", help="take orders there, end when it ends"
    )
    return parser


async def _serve(options: argparse.Namespace) -> None:
    disturbances = Disturbances()
    if options.stand_at is not None:
        disturbances.go_to, disturbances.target = True, options.stand_at
    plant = Plant(
        make_bridge(options.seed),
        shop_climate(options.seed),
        time.monotonic(),
        options.time_factor,
        options.seed,
        options.tool,
        disturbances=disturbances,
    )
    carrier = ProbeCarrier(plant, options.hurry)
    server = IppServer(IppMachine(plant, rotary=options.rotary), options.seats, carrier)
    port = await server.start(options.host, options.port)
    announce(ready=True, protocol="ipp", host=options.host, port=port, pid=os.getpid())
    try:
        await serve_orders(_orders(server), die_with_stdin=options.die_with_stdin)
    finally:
        server.go()


def table_orders(server: IppServer) -> Orders:
    """What somebody at the machine's table can do, and ask of the truth."""
    carrier, plant = server.carrier, server.machine.plant

    def plate(balls: list[list[float]], diameter: float, **lies: Any) -> None:
        carrier.plates[:] = [SimulatedPlate(np.array(balls), diameter, **lies)]

    def gauge(steps: list[list[float]], width: float, height: float, **lies: Any) -> None:
        carrier.gauge = SimulatedGauge(steps, width, height, **lies)

    def clean() -> None:
        carrier.plates.clear()
        carrier.gauge = None

    def table(at: list[float], **wrong: Any) -> None:
        carrier.table = server.machine.table = SimulatedTable(at, **wrong)

    def stuck() -> None:
        if carrier.table is not None:
            carrier.table.stuck = True

    def gone(ball: int, *, back: bool = False) -> None:
        if back:
            carrier.lift()
        for one in carrier.plates:
            one.gone = one.gone - {ball} if back else one.gone | {ball}

    def thermistors(lost: int) -> None:
        plant.disturbances.thermistors_open = lost

    def truth(points: list[list[float]], tool: list[float]) -> dict[str, Any]:
        at = plant.latch(time.monotonic()).temperatures
        errors = plant.machine.error(np.array(points), np.tile(at, (len(points), 1)), tool)
        return {"errors": errors.tolist(), "temperatures": at.tolist()}

    return {
        "plate": plate,
        "gauge": gauge,
        "clean": clean,
        "lift": carrier.lift,
        "table": table,
        "stuck": stuck,
        "gone": gone,
        "thermistors": thermistors,
        "truth": truth,
    }


def _orders(server: IppServer) -> Orders:
    faults = server.faults
    jobs: set[asyncio.Task[None]] = set()

    def silent(seconds: float) -> None:
        faults.silent_until = time.monotonic() + seconds

    def fault(**values: Any) -> None:
        for name, value in values.items():
            if name in ("silent_until", "errors") or not hasattr(faults, name):
                raise KeyError(name)
            setattr(faults, name, value)

    def error(severity: int, number: int, text: str = "", *, unasked: bool = False) -> None:
        if not unasked:
            faults.errors.append((severity, number, text))
            return
        for connection in server.connections:
            if severity >= 2:
                connection.stop()
            connection.say(f'E0000 ! Error({severity}, {number:04d}, "Server", "{text}")\r\n')

    def clear() -> None:
        for connection in server.connections:
            connection.clear()

    def drop() -> None:
        for connection in list(server.connections):
            connection.drop()

    def come() -> None:
        job = asyncio.get_running_loop().create_task(server.restart())
        jobs.add(job)
        job.add_done_callback(jobs.discard)

    def say(text: str) -> None:
        for connection in server.connections:
            connection.say(text)

    def coordinates(name: str) -> None:
        if name not in COORDINATES:
            raise ValueError(name)
        server.machine.coordinates = name

    def report() -> dict[str, Any]:
        return {
            "commands": list(server.commands),
            "nearest_way": server.carrier.nearest_way,
            "clients": len(server.connections),
            "turned_away": server.turned_away,
        }

    return {
        **table_orders(server),
        "silent": silent,
        "fault": fault,
        "error": error,
        "clear": clear,
        "drop": drop,
        "go": server.go,
        "come": come,
        "say": say,
        "coordinates": coordinates,
        "report": report,
    }
