"""The link over a real TCP connection: values, merging, blocks, writes, cancellation, queueing."""

from __future__ import annotations

import asyncio
import math
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from abbe.drivers.link import (
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkState,
    Quality,
    WriteNotVerifiedError,
)
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.link import ModbusLink
from tests.support.drivers.modbus_devices import Memory, Request, TcpDevice

AXES: dict[str, dict[str, Any]] = {
    f"enc_{axis}": {"table": "input", "address": 2 * i, "type": "int32"}
    for i, axis in enumerate("xyz")
}
OUT: dict[str, dict[str, Any]] = {
    f"out_{axis}": {"table": "holding", "address": 100 + 2 * i, "type": "int32", "writable": True}
    for i, axis in enumerate("xyz")
}
STATUS = {"table": "holding", "address": 106, "type": "uint16", "writable": True}


@asynccontextmanager
async def linked(
    port: int, channels: dict[str, dict[str, Any]], **settings: Any
) -> AsyncIterator[ModbusLink]:
    section = {"host": "127.0.0.1", "port": port, "channels": channels, **settings}
    link = ModbusLink("cmm", ModbusConfig.model_validate(section))
    await link.open()
    try:
        yield link
    finally:
        await link.close()


def reads(memory: Memory) -> list[tuple[int, int, int]]:
    return [(r.function, r.address, r.count) for r in memory.requests if r.function <= 4]


async def test_a_batch_is_one_request_and_every_sample_has_its_time() -> None:
    async with TcpDevice() as device, linked(device.port, AXES) as link:
        device.memory.words[1, "input"][:6] = [0, 1, 0xFFFF, 0xFFFE, 0x7FFF, 0xFFFF]
        device.memory.requests.clear()
        before = time.monotonic()
        samples = await link.read(["enc_z", "enc_x", "enc_y"])
        after = time.monotonic()
        assert reads(device.memory) == [(4, 0, 6)]
        assert list(samples) == ["enc_z", "enc_x", "enc_y"]
        assert {name: s.value for name, s in samples.items()} == {
            "enc_x": 1.0,
            "enc_y": -2.0,
            "enc_z": 2147483647.0,
        }
        assert all(s.good and before <= s.time <= after for s in samples.values())
        assert link.status.state is LinkState.UP
        assert 0 < link.status.round_trip <= after - before
        assert link.status.requests == 2


async def test_all_tables_types_and_orders_against_a_pymodbus_server() -> None:
    words = list(struct.unpack(">6H", bytes.fromhex("0A0B0C0D C2F6E979 3FF0 0003")))
    channels: dict[str, dict[str, Any]] = {
        "abcd": {"table": "input", "address": 0, "type": "uint32", "order": "ABCD"},
        "cdab": {"table": "input", "address": 0, "type": "uint32", "order": "CDAB"},
        "badc": {"table": "input", "address": 0, "type": "uint32", "order": "BADC"},
        "dcba": {"table": "input", "address": 0, "type": "uint32", "order": "DCBA"},
        "real": {"table": "input", "address": 2, "type": "float32"},
        "sign": {"table": "input", "address": 2, "type": "int16", "scale": 0.01, "offset": 5.0},
        "bit0": {"table": "input", "address": 5, "type": "bit", "bit": 0},
        "bit2": {"table": "input", "address": 5, "type": "bit", "bit": 2},
        "hold": {"table": "holding", "address": 1, "type": "uint16"},
        "coil": {"table": "coil", "address": 17},
        "disc": {"table": "discrete", "address": 16},
        "out": {"table": "holding", "address": 10, "type": "float64", "order": "DCBA"},
        "word": {"table": "holding", "address": 20, "type": "int16"},
        "relay": {"table": "coil", "address": 3},
        "relays": {"table": "coil", "address": 4},
    }
    for name in ("out", "word", "relay", "relays"):
        channels[name] |= {"writable": True, "verify": True}
    bits = [SimData(0, count=2, values=[False, True] * 8, datatype=DataType.BITS)]
    registers = [SimData(0, values=words + [0] * 30, datatype=DataType.REGISTERS)]
    server = ModbusTcpServer(
        SimDevice(id=1, simdata=(bits, bits, registers, registers)), address=("127.0.0.1", 0)
    )
    await server.serve_forever(background=True)
    try:
        port = server.transport.sockets[0].getsockname()[1]
        async with linked(port, channels) as link:
            values = {n: s.value for n, s in (await link.read(list(channels))).items()}
            assert values["abcd"] == 0x0A0B0C0D
            assert values["cdab"] == 0x0C0D0A0B
            assert values["badc"] == 0x0B0A0D0C
            assert values["dcba"] == 0x0D0C0B0A
            assert values["real"] == struct.unpack(">f", bytes.fromhex("C2F6E979"))[0]
            assert values["sign"] == (0xC2F6 - 0x10000) * 0.01 + 5.0
            assert (values["bit0"], values["bit2"]) == (1.0, 0.0)
            assert values["hold"] == 0x0C0D
            assert (values["coil"], values["disc"]) == (1.0, 0.0)
            await link.write({"out": -1.25e-7, "word": -3, "relay": 1, "relays": 0})
            await link.write({"word": -4})
            await link.write({"relay": 0})
            back = await link.read(["out", "word", "relay", "relays"])
            assert [s.value for s in back.values()] == [-1.25e-7, -4.0, 0.0, 0.0]
    finally:
        await server.shutdown()


async def test_a_slow_block_is_not_read_in_every_cycle() -> None:
    slow = {f"T_{i}": {"table": "input", "address": 50 + i, "type": "uint16"} for i in range(3)}
    channels = AXES | {name: c | {"block": "slow"} for name, c in slow.items()}
    async with (
        TcpDevice() as device,
        linked(device.port, channels, blocks={"slow": {"every": 0.25}}) as link,
    ):
        device.memory.requests.clear()
        names = tuple(channels)
        first = await link.read(names)
        assert reads(device.memory) == [(4, 0, 6), (4, 50, 3)]
        device.memory.words[1, "input"][50] = 77
        second = await link.read(names)
        assert reads(device.memory)[2:] == [(4, 0, 6)]
        assert second["T_0"] is first["T_0"]
        assert second["enc_x"].time > first["enc_x"].time
        assert second["T_0"].age() > second["enc_x"].age()
        await asyncio.sleep(0.26)
        third = await link.read(names)
        assert reads(device.memory)[3:] == [(4, 0, 6), (4, 50, 3)]
        assert third["T_0"].value == 77.0


async def test_blocks_that_are_due_together_share_a_request() -> None:
    channels = {
        "enc": {"table": "input", "address": 0, "type": "int32"},
        "T": {"table": "input", "address": 2, "type": "uint16", "block": "slow"},
    }
    async with (
        TcpDevice() as device,
        linked(device.port, channels, blocks={"slow": {"every": 60.0}}) as link,
    ):
        device.memory.requests.clear()
        await link.read(("enc", "T"))
        await link.read(("enc", "T"))
        assert reads(device.memory) == [(4, 0, 3), (4, 0, 2)]


async def test_three_positions_and_the_status_are_one_write_request() -> None:
    async with TcpDevice() as device, linked(device.port, OUT | {"status": STATUS}) as link:
        device.memory.requests.clear()
        await link.write({"out_x": 1.4, "out_y": -1, "out_z": 70000.0, "status": 3})
        assert device.memory.requests == [Request(1, 16, 100, 7)]
        assert device.memory.words[1, "holding"][100:107] == [0, 1, 65535, 65535, 1, 4464, 3]


async def test_a_verified_write_is_read_back_and_a_stubborn_register_is_named() -> None:
    channels = {n: c | {"verify": n != "out_z"} for n, c in OUT.items()}
    async with TcpDevice() as device, linked(device.port, channels) as link:
        device.memory.requests.clear()
        await link.write({"out_x": 5, "out_y": 6, "out_z": 7})
        assert [(r.function, r.address, r.count) for r in device.memory.requests] == [
            (16, 100, 6),
            (3, 100, 6),
        ]

        def stubborn(request: Request) -> int:
            if request.function == 3:
                device.memory.words[1, "holding"][102:106] = [0, 6, 0, 9]
            return 0

        device.memory.forbidden = stubborn
        with pytest.raises(WriteNotVerifiedError, match="out_y: wrote 0x0000 0x0008, .*0x0006"):
            await link.write({"out_x": 5, "out_y": 8, "out_z": 7})
        # out_z was changed as well, and is not verified.
        await link.write({"out_x": 5, "out_y": 6, "out_z": 7})


@pytest.mark.parametrize("value", [2.0**31, -(2.0**31) - 1, math.nan, math.inf])
async def test_a_value_that_does_not_fit_stops_the_whole_batch(value: float) -> None:
    channels = OUT | {"far": {"table": "holding", "address": 7, "type": "int16", "writable": True}}
    channels["out_y"] = channels["out_y"] | {"unit": "counts"}
    async with TcpDevice() as device, linked(device.port, channels) as link:
        device.memory.requests.clear()
        with pytest.raises(LinkError, match="nothing written; out_y: ") as caught:
            await link.write({"far": 1, "out_x": 1, "out_y": value})
        assert "counts" in str(caught.value)
        if math.isfinite(value):
            assert "-2147483648.0 to 2147483647.0" in str(caught.value)
        assert device.memory.requests == []


async def test_writing_what_is_not_writable_or_unknown() -> None:
    async with TcpDevice() as device, linked(device.port, AXES | OUT) as link:
        device.memory.requests.clear()
        with pytest.raises(LinkError, match="not writable: enc_x"):
            await link.write({"out_x": 1, "enc_x": 1})
        with pytest.raises(LinkConfigError, match="no channel 'out_w'"):
            await link.write({"out_w": 1})
        with pytest.raises(LinkConfigError, match="no channel 'enc_w'"):
            await link.read(["enc_w"])
        await link.write({})
        assert device.memory.requests == []


async def test_a_half_done_write_says_what_is_done() -> None:
    channels = OUT | {"beat": {"table": "holding", "address": 7, "type": "int16", "writable": True}}
    async with TcpDevice() as device, linked(device.port, channels) as link:
        device.memory.forbidden = lambda r: 4 * (r.address == 7)
        with pytest.raises(LinkProtocolError, match=r"not written: beat: .*exception 4, device"):
            await link.write({"out_x": 1, "out_y": 2, "out_z": 3, "beat": 4})
        with pytest.raises(LinkProtocolError, match="written before: out_x"):
            await link.write({"out_x": 1, "beat": 4})


async def test_a_refused_address_costs_only_its_own_channel() -> None:
    channels = {f"c{i}": {"table": "input", "address": i, "type": "int16"} for i in range(8)}
    async with TcpDevice() as device, linked(device.port, channels) as link:
        device.memory.forbidden = lambda r: 2 * (r.address <= 5 < r.address + r.count)
        names = tuple(channels)
        assert all(s.quality is Quality.BAD for s in (await link.read(names)).values())
        for _ in range(3):
            samples = await link.read(names)
        assert [n for n, s in samples.items() if not s.good] == ["c5"]
        assert "input 5 of unit 1: exception 2, illegal data address" in samples["c5"].reason
        assert math.isnan(samples["c5"].value)
        assert link.status.state is LinkState.UP


async def test_a_count_that_a_float_cannot_hold_is_bad_and_says_so() -> None:
    channels = {"enc": {"table": "input", "address": 0, "type": "int64", "unit": "counts"}}
    async with TcpDevice() as device, linked(device.port, channels) as link:
        device.memory.words[1, "input"][:4] = [0x0020, 0, 0, 1]
        sample = (await link.read(["enc"]))["enc"]
        assert sample.quality is Quality.BAD
        assert sample.reason.startswith("enc: the device holds 9007199254740993")
        device.memory.words[1, "input"][:4] = [0x001F, 0xFFFF, 0xFFFF, 0xFFFF]
        assert (await link.read(["enc"]))["enc"].value == 2**53 - 1


async def test_a_cancelled_read_leaves_the_connection_in_step() -> None:
    async with TcpDevice() as device, linked(device.port, AXES, timeout=1.0) as link:
        device.tamper = lambda unit, pdu, frame: [0.1, frame]
        for _ in range(3):
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(link.read(["enc_x"]), 0.05)
            samples = await link.read(["enc_y"])
            assert samples["enc_y"].value == (2 << 16) + 3
        assert device.connections == 1


async def test_calls_queue_up_and_one_too_many_is_turned_away() -> None:
    async with TcpDevice() as device, linked(device.port, AXES | OUT, max_waiting=3) as link:
        device.tamper = lambda unit, pdu, frame: [0.05, frame]
        calls = [asyncio.create_task(link.read(["enc_x"])) for _ in range(4)]
        await asyncio.sleep(0.01)
        turned_away = (await link.read(["enc_x"]))["enc_x"]
        assert turned_away.quality is Quality.UNAVAILABLE
        assert "3 calls already wait" in turned_away.reason
        with pytest.raises(LinkError, match="3 calls already wait"):
            await link.write({"out_x": 1})
        assert all(r["enc_x"].good for r in await asyncio.gather(*calls))


async def test_before_open_and_after_close_nothing_is_available() -> None:
    async with TcpDevice() as device, linked(device.port, AXES | OUT) as link:
        await link.open()
        await link.close()
        await link.close()
        assert link.status.state is LinkState.CLOSED
        sample = (await link.read(["enc_x"]))["enc_x"]
        assert (sample.quality, "is closed" in sample.reason) == (Quality.UNAVAILABLE, True)
        with pytest.raises(LinkDownError, match="not written: out_x"):
            await link.write({"out_x": 1})
        await link.open()
        assert (await link.read(["enc_x"]))["enc_x"].good


async def test_closing_ends_a_request_in_flight_at_once() -> None:
    async with TcpDevice() as device, linked(device.port, AXES, timeout=30.0) as link:
        device.frozen = True
        call = asyncio.create_task(link.read(["enc_x"]))
        await asyncio.sleep(0.02)
        await link.close()
        sample = (await asyncio.wait_for(call, 5.0))["enc_x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert [t for t in asyncio.all_tasks() if "keeper" in t.get_name()] == []
