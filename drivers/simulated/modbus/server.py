"""A real Modbus server, TCP or RTU, for a simulated device. The only file that imports pymodbus.

Registers live in the device; pymodbus's own memory only shapes which addresses exist.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from typing import Protocol, cast

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from abbe.drivers.simulated.bridge.device import (
    NotWritableError,
    Ranges,
    RefusedRequestError,
    WireFaults,
)
from abbe.drivers.simulated.registers import Table

_TABLE: dict[int, Table] = {
    1: "coil",
    5: "coil",
    15: "coil",
    2: "discrete",
    4: "input",
}
"""Table of each function code; all others are holding registers'."""

_REPLY_FIRST = 0.02
"""Time (s) for the answer to the request that asked for its own connection to be cut."""


class RegisterDevice(Protocol):
    """A simulated device with registers, as the server needs one."""

    wire: WireFaults

    @property
    def ranges(self) -> Ranges:
        """Addresses that exist."""

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Words (or bits) within the ranges; raises `RefusedRequestError`."""

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Take values in; raises `NotWritableError`, `RefusedRequestError`."""


class SimulatedServer:
    """One device behind one TCP port or one serial port.

    Parameters
    ----------
    device
        The registers.
    unit
        Modbus unit id; requests for any other are not answered.
    """

    def __init__(self, device: RegisterDevice, unit: int) -> None:
        self._device = device
        self._unit = unit
        self._server: ModbusTcpServer | ModbusSerialServer | None = None
        self._host, self._port = "", 0
        self._reply_once = False
        self._foreign = False
        self._tasks: set[asyncio.Task[None]] = set()

    async def start_tcp(self, host: str, port: int) -> int:
        """Listen on a TCP port (0: any free one); returns the port.

        Raises
        ------
        OSError
            When the port cannot be had.
        """
        self._host, self._port = host, port
        server = ModbusTcpServer(
            self._simdevice(), address=(host, port), trace_packet=self._packet, trace_pdu=self._pdu
        )
        if not await server.listen():
            raise OSError(f"cannot listen on {host}:{port}: in use, or not allowed")
        self._server = server
        listener = cast(asyncio.Server, server.transport)
        self._port = listener.sockets[0].getsockname()[1]
        return self._port

    async def start_rtu(self, port: str, baudrate: int) -> None:
        """Answer on a serial port, 8N1.

        Raises
        ------
        OSError
            When the port cannot be opened.
        """
        server = ModbusSerialServer(
            self._simdevice(), port=port, baudrate=baudrate, trace_packet=self._packet
        )
        if not await server.listen():
            raise OSError(f"cannot open {port}")
        self._server = server

    async def stop(self) -> None:
        """Close everything; safe to call twice."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._server is not None:
            self._server.close()
            self._server = None

    def _simdevice(self) -> SimDevice:
        def bits(table: Table) -> list[SimData]:
            # pymodbus keeps bits in whole registers.
            return [
                SimData(first, count=-(-count // 16), values=[False] * 16, datatype=DataType.BITS)
                for first, count in self._device.ranges[table]
            ]

        def words(table: Table) -> list[SimData]:
            return [
                SimData(first, count=count, values=0, datatype=DataType.REGISTERS)
                for first, count in self._device.ranges[table]
            ]

        return SimDevice(
            id=self._unit,
            simdata=(bits("coil"), bits("discrete"), words("holding"), words("input")),
            action=self._action,
        )

    async def _action(
        self,
        function_code: int,
        start_address: int,
        address: int,
        count: int,
        current: list[int],
        set_values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Answer one request; pymodbus then sends `current`'s words or stores the written ones."""
        now = time.monotonic()
        wire = self._device.wire
        if now < wire.silent_until:
            return ExcCodes.DEVICE_BUSY  # nothing takes effect; `_packet` swallows the answer
        if wire.busy > 0:
            wire.busy -= 1
            return ExcCodes.DEVICE_BUSY
        try:
            self._carry_out(
                _TABLE.get(function_code, "holding"), start_address, address, count, current,
                set_values, now,
            )  # fmt: skip
        except NotWritableError:
            return ExcCodes.ILLEGAL_ADDRESS
        except RefusedRequestError as error:
            return ExcCodes(error.code)
        return None

    def _carry_out(
        self,
        table: Table,
        start_address: int,
        address: int,
        count: int,
        current: list[int],
        set_values: list[int] | list[bool] | None,
        now: float,
    ) -> None:
        device = self._device
        if set_values is not None:
            device.write(table, address, [int(v) for v in set_values], now)
        elif table in ("coil", "discrete"):
            (first, size), *_ = device.ranges[table]
            bits = device.read(table, first, size, now)
            current[0] = sum(bit << i for i, bit in enumerate(bits))
        else:
            words = device.read(table, address, count, now)
            current[address - start_address : address - start_address + count] = words
        self._after_request(now)

    def _pdu(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        """Note whose answer comes next; pymodbus answers for units that do not exist."""
        if sending:
            self._foreign = pdu.dev_id != self._unit
        return pdu

    def _packet(self, sending: bool, data: bytes) -> bytes:
        """Swallow answers while the device is silent, and those of other units."""
        if not sending:
            return data
        once, self._reply_once = self._reply_once, False
        wire = self._device.wire
        spoil, wire.answer = wire.answer, None
        if spoil is not None and not self._foreign:
            return self._spoilt(spoil(data))
        silent = time.monotonic() < wire.silent_until and not once
        return b"" if silent or self._foreign else data

    def _spoilt(self, pieces: Sequence[tuple[float, bytes]]) -> bytes:
        """Send what comes late when it is time; hands back what is to be sent now."""
        for delay, data in pieces:
            if delay > 0.0:
                asyncio.get_running_loop().call_later(delay, self._send, data)
        return b"".join(data for delay, data in pieces if delay <= 0.0)

    def _send(self, data: bytes) -> None:
        server = self._server
        if isinstance(server, ModbusTcpServer):
            for connection in list(server.active_connections.values()):
                connection.send(data)
        elif server is not None:
            server.send(data)

    def _after_request(self, now: float) -> None:
        """Start the connection faults that a request may have asked for."""
        wire = self._device.wire
        if wire.silent_until > now:
            # the request that asked for silence is still answered
            self._reply_once = wire.answer is None
        if wire.drop or wire.offline > 0.0:
            task = asyncio.get_running_loop().create_task(self._cut(wire.offline))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
            wire.drop, wire.offline = False, 0.0

    async def _cut(self, offline: float) -> None:
        """Close all connections and, for `offline` s, the listening socket."""
        await asyncio.sleep(_REPLY_FIRST)
        server = self._server
        if isinstance(server, ModbusSerialServer):
            # A serial line has no connection to lose: it falls silent.
            self._device.wire.silent_until = time.monotonic() + offline
        elif server is not None and offline <= 0.0:
            for connection in list(server.active_connections.values()):
                connection.close()
        elif server is not None:
            server.close()
            self._server = None
            await asyncio.sleep(offline)
            while self._server is None:
                try:
                    await self.start_tcp(self._host, self._port)
                except OSError:
                    await asyncio.sleep(0.1)  # somebody borrowed the port
