"""``python -m abbe.drivers.simulated trunnion``: a five-axis machine with an R-test in its spindle.

Its display and the R-test's box answer on a pseudo-terminal each; orders on standard input
(`abbe.drivers.simulated.remote_control`) have the axes stand elsewhere and put the sphere down.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort
from abbe.drivers.simulated.remote_control import Orders, announce, serve_orders
from abbe.drivers.simulated.serial.devices import AsciiDevice, LineServer
from abbe.drivers.simulated.trunnion.machine import Display, RTest, TrunnionShop


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    parser.add_argument("command", choices=("trunnion",))
    parser.add_argument(
        "--die-with-stdin", action="store_true", help="take orders there, end when it ends"
    )
    asyncio.run(_serve(parser.parse_args(arguments)))
    return 0


async def _serve(options: argparse.Namespace) -> None:
    shop = TrunnionShop()
    later = asyncio.get_running_loop().call_later
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="abbe-trunnion-")))

        def plugged(name: str, device: AsciiDevice) -> str:
            lines = LineServer(device, lambda data: port.send(data), later)
            port = PtyPort(folder / name, lines.receive)
            port.plug()
            stack.callback(port.unplug)
            return str(folder / name)

        announce(
            ready=True, protocol="serial", pid=os.getpid(),
            display=plugged("display", Display(shop)), rtest=plugged("rtest", RTest(shop)),
        )  # fmt: skip

        def sphere(at: list[float]) -> None:
            shop.sphere = (at[0], at[1], at[2])

        orders: Orders = {
            "go": shop.go,
            "sphere": sphere,
            "truth": lambda: {"error": shop.error().tolist()},
        }
        await serve_orders(orders, die_with_stdin=options.die_with_stdin)
