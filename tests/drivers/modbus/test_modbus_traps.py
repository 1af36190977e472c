"""What pymodbus 3.16.1 does by itself, each beside the link, which must not do it.

In every pair the same device misbehaves in the same way. The half on stock pymodbus shows that the
trap is real: should it fail one day, pymodbus has mended it and the guard may go.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusIOException
from pymodbus.framer import FramerRTU

from abbe.drivers.link import LinkProtocolError, LinkState, Quality
from abbe.drivers.modbus.bus import bus, client
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.link import ModbusLink
from tests.support.drivers.modbus_devices import Memory, Request, RtuDevice, TcpDevice

TIMEOUT = 0.2
A, B = 100, 200
"""Two far-apart registers that hold their own address, read by requests of the same shape."""


def at(address: int, **more: Any) -> dict[str, Any]:
    return {"table": "holding", "address": address, "type": "int16"} | more


@asynccontextmanager
async def linked(
    where: dict[str, Any], channels: dict[str, Any], **settings: Any
) -> AsyncIterator[ModbusLink]:
    section = {
        "timeout": TIMEOUT,
        "reconnect_min": 0.02,
        "reconnect_max": 0.1,
        "channels": channels,
    }
    link = ModbusLink("cmm", ModbusConfig.model_validate(section | where | settings))
    await link.open()
    try:
        yield link
    finally:
        await link.close()


def tcp(device: TcpDevice) -> dict[str, Any]:
    return {"host": "127.0.0.1", "port": device.port}


def rtu(device: RtuDevice) -> dict[str, Any]:
    return {"transport": "rtu", "port": device.path, "baudrate": 115200}


@asynccontextmanager
async def stock_tcp(device: TcpDevice, **settings: Any) -> AsyncIterator[AsyncModbusTcpClient]:
    stock = AsyncModbusTcpClient("127.0.0.1", port=device.port, **settings)
    assert await stock.connect()
    try:
        yield stock
    finally:
        stock.close()


@asynccontextmanager
async def stock_rtu(device: RtuDevice) -> AsyncIterator[AsyncModbusSerialClient]:
    stock = AsyncModbusSerialClient(
        device.path, framer=FramerType.RTU, baudrate=115200, timeout=TIMEOUT, retries=0
    )
    assert await stock.connect()
    try:
        yield stock
    finally:
        stock.close()


def late_once(address: int, delay: float) -> Any:
    """A delay for the first request of one address."""
    done: list[int] = []

    def script(request: Request) -> float:
        if request.address != address or done:
            return 0.0
        done.append(1)
        return delay

    return script


def test_pymodbus_is_behind_the_wall() -> None:
    root = Path(client.__file__).parents[3]
    importers = {
        str(path.relative_to(root))
        for package in ("compcore", "drivers", "daemon")
        for path in (root / package).rglob("*.py")
        if re.search(r"^\s*(from|import) pymodbus", path.read_text("utf-8"), re.MULTILINE)
    }
    assert importers == {
        "drivers/modbus/bus/client.py",
        "drivers/modbus/bus/framing.py",
        "drivers/simulated/modbus/server.py",
    }


# A reply that comes late on a serial line.


async def test_stock_rtu_hands_a_late_reply_to_the_next_request() -> None:
    with RtuDevice() as device:
        device.behind = True
        async with stock_rtu(device) as stock:
            with pytest.raises(ModbusIOException):
                await stock.read_holding_registers(A, count=2)
            wrong = await stock.read_holding_registers(B, count=2)
            assert wrong.registers == [A, A + 1]
            wrong = await stock.read_holding_registers(A + 50, count=5)
            assert wrong.registers == [B, B + 1]


@contextmanager
def guards(monkeypatch: pytest.MonkeyPatch, *, framer: bool, resynchronise: bool) -> Iterator[None]:
    class LaxFramer(FramerRTU):
        MAX_SIZE = 1024

        def expect(self, unit: int, answer: bytes, size: int) -> None:
            pass

    with monkeypatch.context() as patch:
        if not framer:
            patch.setattr(client, "StrictRtuFramer", LaxFramer)
        if not resynchronise:
            patch.setattr(bus.Bus, "_expect_late", lambda *_, **__: None)
        yield


async def values_after_a_late_reply(number_type: str, lateness: float) -> list[float]:
    """Every value of channel b that the link calls good, while the reply to a comes late."""
    channels = {"a": at(A, type=number_type), "b": at(B, type=number_type)}
    found = []
    with RtuDevice() as device:
        async with linked(
            rtu(device), channels, late_reply_max=1.5 * lateness, quarantine_after=100
        ) as link:
            device.delay = late_once(A, lateness)
            # where this process itself is held up for so long, the reply is not late for it
            while (await link.read(("a",)))["a"].good:
                device.delay = late_once(A, lateness)
            deadline = time.monotonic() + 3.0 * lateness + 2.0
            while len(found) < 5 and time.monotonic() < deadline:
                sample = (await link.read(("b",)))["b"]
                if sample.good:
                    found.append(sample.value)
                else:
                    await asyncio.sleep(0.01)
    return found


RIGHT = {"int16": float(B), "int32": float((B << 16) + B + 1)}
"""What channel b holds. An int32 can be probed by half of it, an int16 cannot be probed."""


@pytest.mark.parametrize("number_type", ["int16", "int32"])
@pytest.mark.parametrize("lateness", [TIMEOUT + 0.1, 2 * TIMEOUT + 0.2])
async def test_the_link_never_takes_a_late_reply_for_the_answer(
    number_type: str, lateness: float
) -> None:
    assert await values_after_a_late_reply(number_type, lateness) == [RIGHT[number_type]] * 5


@pytest.mark.parametrize("framer", [True, False])
async def test_without_resynchronising_it_does(
    monkeypatch: pytest.MonkeyPatch, framer: bool
) -> None:
    with guards(monkeypatch, framer=framer, resynchronise=False):
        found = await values_after_a_late_reply("int32", TIMEOUT + 0.1)
    assert found[0] == float((A << 16) + A + 1)


async def test_a_late_reply_is_overheard_and_the_answer_behind_it_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def first_after() -> Quality:
        with RtuDevice() as device:
            channels = {"a": at(A, type="int64"), "b": at(B, type="int16")}
            async with linked(rtu(device), channels, quarantine_after=100) as link:
                device.delay = late_once(A, TIMEOUT + 0.1)
                assert not (await link.read(("a",)))["a"].good
                return (await link.read(("b",)))["b"].quality

    assert await first_after() is Quality.GOOD
    with guards(monkeypatch, framer=False, resynchronise=True):
        assert await first_after() is not Quality.GOOD


# A request that is cancelled on a serial line.


async def test_stock_rtu_hands_the_reply_to_a_cancelled_request_to_the_next() -> None:
    with RtuDevice() as device:
        device.delay = late_once(A, 0.1)
        async with stock_rtu(device) as stock:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(stock.read_holding_registers(A, count=1), 0.05)
            assert (await stock.read_holding_registers(B, count=1)).registers == [A]


async def test_the_link_stays_in_step_when_cancelled_on_a_serial_line() -> None:
    with RtuDevice() as device:
        channels = {"a": at(A, type="int32"), "b": at(B, type="int32")}
        async with linked(rtu(device), channels, timeout=1.0) as link:
            device.delay = late_once(A, 0.1)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(link.read(("a",)), 0.05)
            for _ in range(5):
                assert (await link.read(("b",)))["b"].value == RIGHT["int32"]


# Noise on a serial line in front of the answer.

NOISE = bytes((1, 3, 0x40, 0xFF))
"""Looks like the beginning of a long answer."""


async def test_stock_rtu_loses_an_answer_behind_noise() -> None:
    with RtuDevice() as device:
        device.prefix = lambda request: NOISE
        async with stock_rtu(device) as stock:
            with pytest.raises(ModbusIOException):
                await stock.read_holding_registers(A, count=1)


async def test_the_link_finds_an_answer_behind_noise() -> None:
    with RtuDevice() as device:
        device.prefix = lambda request: NOISE
        async with linked(rtu(device), {"a": at(A)}) as link:
            assert (await link.read(("a",)))["a"].value == A


# The defaults.


async def test_stock_defaults_block_for_seconds_and_reconnect_after_minutes() -> None:
    async with TcpDevice() as device, stock_tcp(device) as stock:
        device.frozen = True
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(stock.read_holding_registers(A, count=1), 1.0)
        assert stock.ctx.comm_params.reconnect_delay_max == 300


async def test_the_link_gives_up_after_its_own_timeout() -> None:
    async with TcpDevice() as device, linked(tcp(device), {"a": at(A)}) as link:
        device.frozen = True
        sample = (await asyncio.wait_for(link.read(("a",)), 2.0))["a"]
        assert sample.quality is Quality.UNAVAILABLE


# A connection on which nothing comes any more, while the device takes new ones.


async def test_stock_keeps_a_dead_connection_for_retries_plus_five_calls() -> None:
    async with TcpDevice() as device:
        device.dead_connections = {1}
        async with stock_tcp(device, timeout=0.05, retries=1, reconnect_delay=0) as stock:
            calls = 0
            while stock.connected:
                calls += 1
                with pytest.raises(ModbusIOException):
                    await stock.read_holding_registers(A, count=1)
            assert calls == 6


async def test_the_link_leaves_a_dead_connection_after_quarantine_after_calls() -> None:
    async with TcpDevice() as device, linked(tcp(device), {"a": at(A)}) as link:
        device.dead_connections = {1}
        for _ in range(2):
            assert not (await link.read(("a",)))["a"].good
        assert link.status.state is LinkState.DOWN
        await asyncio.sleep(0.02)
        deadline = time.monotonic() + 5.0
        while not (await link.read(("a",)))["a"].good:
            assert time.monotonic() < deadline
            await asyncio.sleep(0.01)
        assert device.connections == 2


# A connection lost while a request is in flight.


async def test_stock_waits_for_its_timeout_when_the_connection_is_lost() -> None:
    async with TcpDevice() as device, stock_tcp(device, timeout=0.5, retries=0) as stock:
        device.tamper = lambda unit, pdu, frame: [-1.0]
        began = time.monotonic()
        with pytest.raises(ModbusIOException):
            await stock.read_holding_registers(A, count=1)
        assert time.monotonic() - began > 0.45


async def test_the_link_notices_the_loss_at_once() -> None:
    async with TcpDevice() as device, linked(tcp(device), {"a": at(A)}, timeout=30.0) as link:
        device.tamper = lambda unit, pdu, frame: [-1.0]
        sample = (await asyncio.wait_for(link.read(("a",)), 5.0))["a"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "the connection was closed by the other side" in sample.reason


# Errors raised, and errors returned.


async def test_stock_returns_some_errors_and_raises_others() -> None:
    async with TcpDevice() as device, stock_tcp(device, reconnect_delay=0) as stock:
        device.memory.forbidden = lambda request: 4
        answer = await stock.read_holding_registers(A, count=1)
        assert answer.isError()
        assert answer.registers == []
        await device.stop()
        await asyncio.sleep(0.05)
        with pytest.raises(ConnectionException):
            await stock.read_holding_registers(A, count=1)


async def test_the_link_never_raises_on_read_and_always_on_write() -> None:
    channels = {"a": at(A), "out": at(B, writable=True)}
    async with TcpDevice() as device, linked(tcp(device), channels) as link:
        device.memory.forbidden = lambda request: 4
        sample = (await link.read(("a",)))["a"]
        assert sample.quality is Quality.BAD
        assert sample.reason == "holding 100 of unit 1: exception 4, device failure"
        with pytest.raises(LinkProtocolError, match="device failure"):
            await link.write({"out": 1})
        assert link.status.failures == 2


# Answers that do not fit the request.


def too_short(unit: int, pdu: bytes, frame: bytes) -> list[bytes | float]:
    """Three registers, whatever was asked."""
    return [frame[:4] + bytes((0, 9, unit, pdu[0], 6)) + bytes(range(6))]


async def test_stock_returns_three_registers_of_five() -> None:
    async with TcpDevice() as device, stock_tcp(device) as stock:
        device.tamper = too_short
        answer = await stock.read_holding_registers(A, count=5)
        assert not answer.isError()
        assert len(answer.registers) == 3


async def test_the_link_refuses_three_registers_of_four() -> None:
    async with TcpDevice() as device, linked(tcp(device), {"a": at(A, type="int64")}) as link:
        device.tamper = too_short
        sample = (await link.read(("a",)))["a"]
        assert sample.quality is Quality.BAD
        assert "6 bytes came in answer, 8 were asked" in sample.reason


def other_function(unit: int, pdu: bytes, frame: bytes) -> list[bytes | float]:
    """Input registers, where holding registers were asked."""
    return [frame[:7] + b"\x04" + frame[8:]]


async def test_stock_takes_the_answer_of_another_function() -> None:
    async with TcpDevice() as device, stock_tcp(device) as stock:
        device.tamper = other_function
        answer = await stock.read_holding_registers(A, count=1)
        assert (answer.function_code, answer.registers) == (4, [A])


async def test_the_link_refuses_the_answer_of_another_function() -> None:
    async with TcpDevice() as device, linked(tcp(device), {"a": at(A)}) as link:
        device.tamper = other_function
        sample = (await link.read(("a",)))["a"]
        assert sample.quality is Quality.BAD
        assert "function 4 answered, function 3 was asked" in sample.reason


def other_address(unit: int, pdu: bytes, frame: bytes) -> list[bytes | float]:
    return [frame[:8] + b"\x00\x01" + frame[10:]] if pdu[0] == 16 else [frame]


async def test_stock_takes_the_confirmation_of_another_write() -> None:
    async with TcpDevice() as device, stock_tcp(device) as stock:
        device.tamper = other_address
        answer = await stock.write_registers(B, [1, 2])
        assert not answer.isError()
        assert answer.address == 1


async def test_the_link_refuses_the_confirmation_of_another_write() -> None:
    channels = {"out": at(B, type="int32", writable=True)}
    async with TcpDevice() as device, linked(tcp(device), channels) as link:
        device.tamper = other_address
        with pytest.raises(LinkProtocolError, match=r"confirmed \(1, 2\), expected \(200, 2\)"):
            await link.write({"out": 1})


def undecodable(unit: int, pdu: bytes, frame: bytes) -> list[bytes | float]:
    """A function that does not exist."""
    return [frame[:7] + b"\x63" + frame[8:]]


async def test_stock_raises_an_undecodable_answer_into_asyncio() -> None:
    reported: list[dict[str, Any]] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: reported.append(context))
    async with (
        TcpDevice() as device,
        stock_tcp(device, timeout=TIMEOUT, retries=0, reconnect_delay=0) as stock,
    ):
        device.tamper = undecodable
        with pytest.raises(ModbusIOException):
            await stock.read_holding_registers(A, count=1)
    assert isinstance(reported[0]["exception"], ModbusIOException)


async def test_the_link_takes_an_undecodable_answer_for_none() -> None:
    reported: list[dict[str, Any]] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: reported.append(context))
    async with TcpDevice() as device, linked(tcp(device), {"a": at(A)}) as link:
        device.tamper = undecodable
        assert (await link.read(("a",)))["a"].quality is Quality.UNAVAILABLE
    assert reported == []


# Late replies on TCP.


class ZeroTransactions:
    """A gateway that does not return the transaction number, and is late once, at register A.

    The late answer comes when the next question does, however busy the computer is.
    """

    def __init__(self) -> None:
        self.late: list[bytes | float] | None = None

    def __call__(self, unit: int, pdu: bytes, frame: bytes) -> list[bytes | float]:
        answer = b"\0\0" + frame[2:]
        if self.late is None and pdu[1:3] == bytes((0, A)):
            self.late = [answer]
            return []
        late, self.late = self.late or [], []
        return [*late, answer]


async def test_stock_tcp_takes_transaction_0_for_the_answer_to_anything() -> None:
    async with TcpDevice() as device, stock_tcp(device, timeout=TIMEOUT, retries=0) as stock:
        device.tamper = ZeroTransactions()
        with pytest.raises(ModbusIOException):
            await stock.read_holding_registers(A, count=1)
        assert (await stock.read_holding_registers(B, count=1)).registers == [A]


async def test_the_link_does_not_believe_transaction_0() -> None:
    channels = {"a": at(A), "b": at(B)}
    async with TcpDevice() as device, linked(tcp(device), channels) as link:
        device.tamper = ZeroTransactions()
        assert not (await link.read(("a",)))["a"].good
        for _ in range(3):
            assert not (await link.read(("b",)))["b"].good


class TornAnswer:
    """The answer of A comes in two halves, the second by its content like an answer.

    The second half comes when the next question does, however busy the computer is.
    """

    def __init__(self, transaction: int) -> None:
        self.forged = bytes((0, transaction, 0, 0, 0, 5, 1, 3, 2, 0x2B, 0xAD))
        self.late: list[bytes | float] | None = None

    def __call__(self, unit: int, pdu: bytes, frame: bytes) -> list[bytes | float]:
        if self.late is None and pdu[1:3] == bytes((0, A)):
            self.late = [self.forged]
            return [frame[: -len(self.forged)]]
        late, self.late = self.late or [], []
        return [*late, frame]


async def test_stock_tcp_parses_the_second_half_of_a_late_answer_as_an_answer() -> None:
    async with TcpDevice() as device, stock_tcp(device, timeout=TIMEOUT, retries=0) as stock:
        device.tamper = TornAnswer(transaction=2)
        with pytest.raises(ModbusIOException):
            await stock.read_holding_registers(A, count=20)
        assert (await stock.read_holding_registers(B, count=1)).registers == [0x2BAD]


async def test_the_link_leaves_a_connection_that_is_out_of_step() -> None:
    channels = {f"a{i}": at(A + i) for i in range(20)} | {"b": at(B)}
    block = tuple(n for n in channels if n != "b")
    async with TcpDevice() as device, linked(tcp(device), channels) as link:
        # The probe at opening is transaction 1, the block 2, channel b 3.
        device.tamper = TornAnswer(transaction=3)
        samples = await link.read(block)
        assert "out of step" in samples["a0"].reason
        assert link.status.state is LinkState.DOWN
        deadline = time.monotonic() + 5.0
        while not (sample := (await link.read(("b",)))["b"]).good:
            assert time.monotonic() < deadline
            await asyncio.sleep(0.01)
        assert sample.value == B
        assert device.connections == 2


async def test_a_late_whole_answer_on_tcp_does_not_cost_the_connection() -> None:
    channels = {"a": at(A), "b": at(B)}
    async with (
        TcpDevice(Memory()) as device,
        linked(tcp(device), channels, quarantine_after=100) as link,
    ):
        late = iter([TIMEOUT + 0.05])
        device.tamper = lambda unit, pdu, frame: [next(late, 0.0), frame]
        assert not (await link.read(("a",)))["a"].good
        assert (await link.read(("b",)))["b"].value == B
        assert device.connections == 1
