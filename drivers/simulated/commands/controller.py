"""``python -m abbe.drivers.simulated controller``: a control with a memory for tables."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import hashlib
import logging
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abbe.drivers.simulated.controller.table_faults import Faults, TableFault
from abbe.drivers.simulated.controller.table_memory import TableMemory
from abbe.drivers.simulated.remote_control import Orders, announce, serve_orders

if TYPE_CHECKING:
    from abbe.drivers.simulated.controller.canopen_tables import TableNode
    from abbe.drivers.simulated.controller.table_lines import TableLines
    from abbe.drivers.simulated.controller.table_registers import TableDevice


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns the exit status."""
    options = _parser().parse_args(arguments)
    logging.getLogger("pymodbus_internal").setLevel(logging.CRITICAL)
    logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
    serve = {"modbus": _modbus, "serial": _serial, "canopen": _canopen}[options.protocol]
    try:
        asyncio.run(serve(options))
    except OSError as error:
        print(f"simulated controller: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    parser.add_argument("command", choices=("controller",))
    parser.add_argument("protocol", choices=("modbus", "serial", "canopen"))
    parser.add_argument("--memory", type=Path, help="file of the active tables; default: none")
    parser.add_argument("--capacity", type=int, default=1 << 20, help="bytes of an image")
    parser.add_argument("--acts-late", action="store_true", help="tables act only after a restart")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=0, help="TCP port; 0: any free one")
    parser.add_argument("--rtu", action="store_true", help="modbus: RTU over a pseudo-terminal")
    parser.add_argument("--baudrate", type=int, default=115200, help="RTU: not paced")
    parser.add_argument("--link", type=Path, help="serial, canopen: path to the port")
    parser.add_argument("--die-with-stdin", action="store_true", help="take orders there")
    return parser


def _memory(options: argparse.Namespace) -> TableMemory:
    return TableMemory(options.memory, options.capacity, acts_late=options.acts_late)


async def _modbus(options: argparse.Namespace) -> None:
    from abbe.drivers.simulated.controller.table_registers import UNIT_ID, TableDevice
    from abbe.drivers.simulated.modbus.server import SimulatedServer
    from abbe.drivers.simulated.pseudo_terminals.pty_pair import PtyPair

    faults = Faults()
    device = TableDevice(_memory(options), faults)
    server = SimulatedServer(device, UNIT_ID)
    cable: PtyPair | None = None
    where: dict[str, object]
    try:
        if options.rtu:
            cable = PtyPair()
            cable.start()
            await server.start_rtu(cable.near, options.baudrate)
            where = {"protocol": "rtu", "device": cable.far, "baudrate": options.baudrate}
        else:
            port = await server.start_tcp(options.host, options.port)
            where = {"protocol": "tcp", "host": options.host, "port": port}
        announce(ready=True, **where, unit=UNIT_ID, pid=os.getpid())
        await serve_orders(_orders(device, faults), die_with_stdin=options.die_with_stdin)
    finally:
        await server.stop()
        if cable is not None:
            cable.close()


async def _serial(options: argparse.Namespace) -> None:
    from abbe.drivers.simulated.controller.table_lines import TableLines

    faults = Faults()
    with contextlib.ExitStack() as stack:
        link: Path | None = options.link
        if link is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="abbe-control-"))
            link = Path(folder) / "control"
        control = TableLines(_memory(options), faults, link)
        control.port.plug()
        stack.callback(control.port.unplug)
        work = asyncio.ensure_future(control.work())
        announce(ready=True, protocol="serial", device=str(link), pid=os.getpid())
        try:
            await serve_orders(_orders(control, faults), die_with_stdin=options.die_with_stdin)
        finally:
            work.cancel()
            await asyncio.gather(work, return_exceptions=True)


async def _canopen(options: argparse.Namespace) -> None:
    from abbe.drivers.simulated.can.adapter import LawicelAdapter
    from abbe.drivers.simulated.can.wire import CanWire
    from abbe.drivers.simulated.controller.canopen_tables import NODE, TableNode
    from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort

    faults = Faults()
    with contextlib.ExitStack() as stack:
        link: Path | None = options.link
        if link is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="abbe-control-"))
            link = Path(folder) / "slcan"
        wire = CanWire()
        node = TableNode(wire, _memory(options), faults)
        adapter = LawicelAdapter(wire, lambda receive: PtyPort(link, receive))
        adapter.port.plug()
        stack.callback(adapter.port.unplug)

        def unplug() -> None:
            adapter.reset()
            adapter.port.unplug()

        orders: dict[str, Any] = {
            "unplug": unplug,
            "plug": adapter.port.plug,
            "break": lambda: setattr(wire, "broken", True),
            "mend": lambda: setattr(wire, "broken", False),
            "blocks": lambda refused: setattr(node.sdo.faults, "refused", refused),
        }
        orders.update(_orders(node, faults))
        node.boot()
        announce(ready=True, protocol="canopen", interface="slcan", channel=str(link), node=NODE)
        await serve_orders(orders, die_with_stdin=options.die_with_stdin)


def _orders(control: TableDevice | TableLines | TableNode, faults: Faults) -> Orders:
    memory = control.memory

    def truth() -> dict[str, Any]:
        return {
            "active": {
                name: hashlib.sha256(text.encode()).hexdigest()
                for name, text in memory.files.items()
            },
            "image": hashlib.sha256(memory.active).hexdigest() if memory.active else "",
            "staged": len(memory.staged),
            "happened": faults.happened,
            "asked": faults.asked,
            "restarts": memory.restarts,
        }

    def machine(*, idle: bool = True, referenced: bool = True, protected: bool = False) -> None:
        memory.idle, memory.referenced, control.protected = idle, referenced, protected

    def reset() -> None:
        """Whatever was ordered is over; what is active stays."""
        faults.clear()
        machine()
        control.wake()
        memory.discard()

    def power_cut() -> None:
        control.restart()

    def load(files: dict[str, str]) -> None:
        """Make files active as somebody at the control would."""
        memory.load(files)

    return {
        "fault": lambda **what: faults.arm(TableFault(**what)),
        "clear": faults.clear,
        "wake": control.wake,
        "machine": machine,
        "truth": truth,
        "reset": reset,
        "power_cut": power_cut,
        "load": load,
    }
