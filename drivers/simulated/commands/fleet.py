"""``python -m abbe.drivers.simulated fleet``: many machines of one type, one Modbus port each.

Orders on standard input (`abbe.drivers.simulated.remote_control`): ``{"do": "probe"}`` has every
machine probe its spheres, ``{"do": "probe", "machine": 2}`` one of them.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from abbe.drivers.simulated.bridge.checks import WhatHappens
from abbe.drivers.simulated.bridge.happened import Happened
from abbe.drivers.simulated.fleet.device import SimulatedFleetMachine
from abbe.drivers.simulated.fleet.past import past_checks, stands
from abbe.drivers.simulated.modbus.server import SimulatedServer
from abbe.drivers.simulated.remote_control import announce, serve_orders

UNIT = 1
CRASH = 10e-6
"""By how much X is turned on Y of a machine that has crashed, rad."""


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns the exit status."""
    options = _parser().parse_args(arguments)
    if not 0 <= options.drifting <= options.machines:
        print("simulated fleet: --drifting names none of the machines", file=sys.stderr)  # noqa: T201
        return 2
    logging.getLogger("pymodbus_internal").setLevel(logging.CRITICAL)
    logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        print(f"simulated fleet: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    parser.add_argument("command", choices=("fleet",))
    parser.add_argument("--machines", type=int, default=3, choices=range(1, 201), metavar="N")
    parser.add_argument("--seed", type=int, default=1, help="of the machines: all are of one type")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=0, help="first of N; 0: any free ones")
    parser.add_argument(
        "--drifting",
        type=int,
        default=0,
        metavar="K",
        help="one that has changed, from 1; 0: none",
    )
    parser.add_argument("--past", type=Path, help="folder for the checks of each until yesterday")
    parser.add_argument("--die-with-stdin", action="store_true", help="end when the input ends")
    return parser


async def _serve(options: argparse.Namespace) -> None:
    machines: list[SimulatedFleetMachine] = []
    async with contextlib.AsyncExitStack() as stack:
        facts: list[dict[str, Any]] = []
        for number in range(1, options.machines + 1):
            changed = number == options.drifting
            what: WhatHappens = "crash" if changed else "nothing"
            past = past_checks(options.seed, number, what, time.time())
            happened = Happened(squareness=CRASH) if changed else Happened()
            machine = SimulatedFleetMachine(options.seed, number, happened, stands(past))
            server = SimulatedServer(machine, UNIT)
            wanted = options.port + number - 1 if options.port else 0
            port = await server.start_tcp(options.host, wanted)
            stack.push_async_callback(server.stop)
            machines.append(machine)
            fact: dict[str, Any] = {"machine": number, "host": options.host, "port": port}
            if options.past is not None:
                fact["past"] = str(_keep(options.past / f"machine-{number}.csv", past))
            facts.append(fact)
        announce(ready=True, protocol="tcp", unit=UNIT, machines=facts)

        def probe(machine: int = 0) -> dict[str, Any]:
            chosen = machines if not machine else [machines[machine - 1]]
            for one in chosen:
                one.probe(time.monotonic())  # the servers' clock
            return {"machines": len(chosen)}

        def written() -> dict[str, Any]:
            return {"written": [one.writes for one in machines]}

        orders = {"probe": probe, "written": written}
        await serve_orders(orders, die_with_stdin=options.die_with_stdin)


def _keep(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(text, encoding="utf-8")
    return unfinished.replace(path)
