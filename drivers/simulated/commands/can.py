"""``python -m abbe.drivers.simulated can``: encoders, thermometer, controller on a CAN bus."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import sys
import tempfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from abbe.drivers.simulated.can.adapter import LawicelAdapter, Reports
from abbe.drivers.simulated.can.devices import (
    ENCODERS,
    CanopenController,
    FrameSender,
    encoder,
    thermometer,
)
from abbe.drivers.simulated.can.sdo_server import BlockFaults
from abbe.drivers.simulated.can.wire import CanFrame, CanWire, MulticastEnd
from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort
from abbe.drivers.simulated.remote_control import Orders, announce, serve_orders

FAULTS = ("silent", "deaf", "late", "heart_stopped", "heartbeat_fixed", "transmission")
"""What can be set of a node."""


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns the exit status."""
    options = _parser().parse_args(arguments)
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        print(f"simulated CAN bus: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m abbe.drivers.simulated")
    parser.add_argument("command", choices=("can",))
    parser.add_argument(
        "--link", type=Path, help="slcan adapter: path that always leads to its port; default: any"
    )
    parser.add_argument(
        "--udp", metavar="GROUP:PORT", help="python-can's udp_multicast instead of an adapter"
    )
    parser.add_argument(
        "--reports",
        choices=get_args(Reports),
        default="nothing",
        help="how the adapter tells its controller's state: not, as status flags, as lines",
    )
    parser.add_argument(
        "--frames", type=float, default=0.0, metavar="S", help="send machine.dbc's so often; 0: not"
    )
    parser.add_argument(
        "--event", type=float, default=0.0, metavar="S", help="TPDO1 of the nodes so often; 0: not"
    )
    parser.add_argument(
        "--die-with-stdin", action="store_true", help="take orders there, end when it ends"
    )
    return parser


class _Bus:
    """What is on the bus: encoders, thermometer, controller, and frames of a DBC file."""

    def __init__(self, wire: CanWire, event: float) -> None:
        self._wire = wire
        self._temperatures = [20.0, 21.25, 22.5, -3.75]
        self._controller = CanopenController(wire)
        self.frames = FrameSender(wire)
        self.nodes = [encoder(wire, number, event) for number in ENCODERS]
        self.nodes += [thermometer(wire, self._temperatures, event), self._controller.node]
        self._by_number = {node.number: node for node in self.nodes}

    def orders(self) -> dict[str, Any]:
        """Order → what carries it out."""
        return {
            "node": self._node,
            "boot": lambda number: self._by_number[number].boot(),
            "emergency": self._emergency,
            "error_frame": self._error_frame,
            "block": self._block,
            "temperature": self._temperature,
            "mute": self._mute,
            "page": self._page,
            "report": self._report,
            "fault": self._wire.set_faults,
            "break": lambda: setattr(self._wire, "broken", True),
            "mend": lambda: setattr(self._wire, "broken", False),
        }

    async def send_frames(self, period: float) -> None:
        """Send the DBC file's messages every so many s."""
        while True:
            self.frames.send()
            await asyncio.sleep(period)

    def _node(self, number: int, **values: Any) -> None:
        for name, value in values.items():
            if name not in FAULTS:
                raise KeyError(name)
            setattr(self._by_number[number], name, value)

    def _emergency(self, number: int, code: int, register: int) -> None:
        self._by_number[number].emergency(code, register)

    def _error_frame(self, id: int, data: str) -> None:
        # an adapter makes them up; only udp_multicast carries them
        self.frames.speak(CanFrame(id, bytes.fromhex(data), error=True))

    def _block(
        self,
        lose: Sequence[int] = (),
        *,
        hang_after: int | None = None,
        spoil: bool = False,
        refused: bool = False,
    ) -> None:
        faults = BlockFaults(set(lose), hang_after, spoil, refused)
        self._controller.node.sdo.faults = faults

    def _temperature(self, values: list[float]) -> None:
        self._temperatures[:] = values

    def _mute(self, *, muted: bool) -> None:
        self.frames.muted = muted

    def _page(self, *, only: int | None) -> None:
        self.frames.only_page = only

    def _report(self) -> dict[str, Any]:
        controller, setpoints = self._controller, self.frames.setpoints
        return {
            "table_length": len(controller.table),
            "table_crc32": zlib.crc32(controller.table),
            "active": controller.active,
            "offset": controller.offset,
            "setpoints_taken": len(setpoints),
            "setpoints": [data.hex() for data in setpoints[-5:]],
            "states": {str(n.number): n.state for n in self.nodes},
            "heartbeats": {str(n.number): n.heartbeat_every for n in self.nodes},
        }


async def _serve(options: argparse.Namespace) -> None:
    wire = CanWire()
    bus = _Bus(wire, options.event)
    orders = bus.orders()
    with contextlib.ExitStack() as stack:
        where = _open(options, wire, stack, orders)
        jobs = [asyncio.ensure_future(n.live()) for n in bus.nodes]
        if options.frames:
            jobs.append(asyncio.ensure_future(bus.send_frames(options.frames)))
        for n in bus.nodes:
            n.boot()
        announce(ready=True, protocol="can", pid=os.getpid(), **where)
        try:
            await serve_orders(orders, die_with_stdin=options.die_with_stdin)
        finally:
            for job in jobs:
                job.cancel()
            await asyncio.gather(*jobs, return_exceptions=True)


def _open(
    options: argparse.Namespace, wire: CanWire, stack: contextlib.ExitStack, orders: dict[str, Any]
) -> dict[str, Any]:
    """The way out of this process; hands back python-can's settings to get in there."""
    if options.udp:
        group, _, port = options.udp.rpartition(":")
        stack.callback(MulticastEnd(wire, group, int(port)).close)
        return {"interface": "udp_multicast", "channel": group, "port": int(port)}
    link: Path | None = options.link
    if link is None:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="abbe-can-"))
        link = Path(folder) / "slcan"
    adapter = LawicelAdapter(wire, lambda receive: PtyPort(link, receive), options.reports)
    adapter.port.plug()
    stack.callback(adapter.port.unplug)

    def unplug() -> None:
        adapter.reset()
        adapter.port.unplug()

    def adapter_report() -> dict[str, Any]:
        faults = adapter.faults
        return {
            "openings": adapter.openings,
            "state": faults.state,
            "errors": {"transmit": faults.transmit, "receive": faults.receive},
        }

    more: Orders = {
        "adapter": adapter_report,
        "unplug": unplug,
        "plug": adapter.port.plug,
        "reset_adapter": adapter.reset,
        "deaf_adapter": lambda deaf: setattr(adapter, "deaf", deaf),
        "hung_adapter": lambda hung: setattr(adapter, "hung", hung),
    }
    orders.update(more)
    return {"interface": "slcan", "channel": str(link)}
