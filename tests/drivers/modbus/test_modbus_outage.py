"""Outages: stopped and frozen servers, dead units among living ones, bounded waits, recovery."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from abbe.drivers.link import LinkDownError, LinkState, LinkTimeoutError, Quality
from abbe.drivers.modbus.bus.units import Unit
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.link import ModbusLink
from tests.support.drivers.modbus_devices import Memory, TcpDevice
from tests.support.drivers.opening import until

TIMEOUT = 0.15
ROOM = 1.0
"""s that a shared machine may add to any wait."""


def three_units() -> dict[str, dict[str, Any]]:
    return {
        f"u{unit}_{i}": {
            "table": "input",
            "address": 40 * i,
            "type": "int16",
            "unit_id": unit,
        }
        for unit in (1, 2, 3)
        for i in range(2)
    } | {"out": {"table": "holding", "address": 9, "type": "int16", "writable": True}}


ONE_UNIT = {
    "enc": {"table": "input", "address": 1, "type": "int16"},
    "T": {"table": "input", "address": 2, "type": "int16", "block": "slow"},
    "out": {"table": "holding", "address": 9, "type": "int16", "writable": True},
}


@asynccontextmanager
async def linked(
    port: int, channels: dict[str, dict[str, Any]], **settings: Any
) -> AsyncIterator[ModbusLink]:
    section: dict[str, Any] = {
        "host": "127.0.0.1",
        "port": port,
        "timeout": TIMEOUT,
        "reconnect_min": 0.02,
        "reconnect_max": 0.2,
        "quarantine_max": 0.4,
        "blocks": {"slow": {"every": 60.0}},
        "channels": channels,
    }
    link = ModbusLink("cmm", ModbusConfig.model_validate(section | settings))
    await link.open()
    try:
        yield link
    finally:
        await link.close()


async def timed_read(link: ModbusLink, names: tuple[str, ...]) -> tuple[dict[str, Any], float]:
    began = time.monotonic()
    samples = await link.read(names)
    return samples, time.monotonic() - began


async def test_a_stopped_server_is_noticed_at_once_and_found_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "abbe")
    names = ("enc", "T")
    async with TcpDevice() as device, linked(device.port, ONE_UNIT) as link:
        assert all(s.good for s in (await link.read(names)).values())
        await device.stop()
        await until(lambda: link.status.state is LinkState.DOWN)
        for _ in range(20):
            samples, took = await timed_read(link, names)
            assert took < TIMEOUT
            assert [s.quality for s in samples.values()] == [Quality.UNAVAILABLE] * 2
            assert "is down" in samples["T"].reason
            with pytest.raises(LinkDownError, match="not written: out"):
                await link.write({"out": 1})
            await asyncio.sleep(0.02)
        assert link.status.state is LinkState.DOWN
        assert "Connect call failed" in link.status.detail
        device.memory.words[1, "input"][2] = 4242
        await device.start()
        await until(lambda: link.status.state is LinkState.UP, limit=0.2 + ROOM)
        samples = await link.read(names)
        assert samples["T"].value == 4242.0
        assert link.status.reconnects == 1
        await link.write({"out": 1})
    said = [r.getMessage() for r in caplog.records if r.name == "abbe.drivers.modbus"]
    assert len(said) == 2
    assert f"link cmm (127.0.0.1:{device.port}) lost: " in said[0]
    assert "back after" in said[1]


async def test_a_server_that_appears_after_open_is_found() -> None:
    device = TcpDevice()
    await device.start()
    await device.stop()
    async with linked(device.port, ONE_UNIT) as link:
        assert link.status.state is LinkState.DOWN
        assert not (await link.read(("enc",)))["enc"].good
        await device.start()
        await until(lambda: link.status.state is LinkState.UP)
        assert (await link.read(("enc",)))["enc"].good
        await device.stop()


async def test_a_frozen_server_blocks_no_call_longer_than_a_timeout(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "abbe")
    names = ("enc", "T")
    async with TcpDevice() as device, linked(device.port, ONE_UNIT) as link:
        assert (await link.read(names))["enc"].good
        device.frozen = True
        samples, took = await timed_read(link, names)
        assert samples["enc"].quality is Quality.UNAVAILABLE
        assert took < TIMEOUT + ROOM
        await link.read(names)
        assert link.status.state is LinkState.DOWN
        assert "no unit answers" in link.status.detail
        for _ in range(10):
            samples, took = await timed_read(link, names)
            assert took < TIMEOUT
            assert not any(s.good for s in samples.values())
        await asyncio.sleep(0.5)
        # Accepting connections is not answering: the link must not flap.
        assert link.status.state is LinkState.DOWN
        device.frozen = False
        await until(lambda: link.status.state is LinkState.UP, limit=0.2 + TIMEOUT + ROOM)
        assert (await link.read(names))["enc"].good
    said = [r.getMessage() for r in caplog.records if r.name == "abbe.drivers.modbus"]
    assert [("lost" in text, "back" in text) for text in said] == [(True, False), (False, True)]


async def test_one_dead_unit_among_three_costs_the_others_nothing_but_a_bounded_wait(
    caplog: pytest.LogCaptureFixture,
) -> None:
    channels = three_units()
    names = tuple(n for n in channels if n != "out")
    device = TcpDevice(Memory(units=(1, 2, 3)))
    async with device, linked(device.port, channels) as link:
        device.memory.silent = {2}
        waits, reasons = [], []
        for _ in range(60):
            samples, took = await timed_read(link, names)
            waits.append(took)
            assert [n for n, s in samples.items() if not s.good] == ["u2_0", "u2_1"]
            assert samples["u2_0"].quality is Quality.UNAVAILABLE
            reasons.append(samples["u2_0"].reason)
            await asyncio.sleep(0.01)
        assert max(waits) < TIMEOUT + ROOM
        # Left alone most of the time: a fixed retry would have cost one time-out in every call.
        asked = [r for r in device.memory.requests if r.unit == 2]
        assert len(asked) < 10
        assert link.status.state is LinkState.DEGRADED
        assert list(link.status.quarantined) == ["unit 2"]
        # unless it was asked just then
        assert sum("asked again in" in reason for reason in reasons) > 60 - 10
        device.memory.silent = set()
        deadline = time.monotonic() + 0.4 + ROOM
        while not (await link.read(names))["u2_1"].good:
            assert time.monotonic() < deadline
            await asyncio.sleep(0.01)
        assert link.status.state is LinkState.UP
        assert link.status.quarantined == {}
        assert device.connections == 1
    said = [r.getMessage() for r in caplog.records if r.name == "abbe.drivers.modbus"]
    assert [("unit 2 set apart" in t, "unit 2 answers again" in t) for t in said] == [
        (True, False),
        (False, True),
    ]


async def test_two_units_falling_silent_together_cost_two_timeouts_once() -> None:
    channels = three_units()
    names = tuple(n for n in channels if n != "out")
    device = TcpDevice(Memory(units=(1, 2, 3)))
    async with device, linked(device.port, channels) as link:
        await link.read(names)
        device.memory.silent = {1, 2}
        first, took = await timed_read(link, names)
        assert took < 2 * TIMEOUT + ROOM
        assert not first["u1_0"].good
        # The living unit is asked first from now on.
        for _ in range(10):
            samples = await link.read(names)
            assert samples["u3_0"].good
            assert samples["u3_1"].good


async def test_a_dead_unit_from_the_start_does_not_keep_the_link_down() -> None:
    channels = three_units()
    device = TcpDevice(Memory(units=(1, 2, 3), silent={1}))
    async with device, linked(device.port, channels) as link:
        assert link.status.state in (LinkState.UP, LinkState.DEGRADED)
        assert (await link.read(("u2_0",)))["u2_0"].good


async def test_a_frozen_bus_of_three_units_goes_down_and_comes_back() -> None:
    channels = three_units()
    names = tuple(n for n in channels if n != "out")
    device = TcpDevice(Memory(units=(1, 2, 3)))
    async with device, linked(device.port, channels) as link:
        await link.read(names)
        device.frozen = True
        while link.status.state is not LinkState.DOWN:
            _, took = await timed_read(link, names)
            assert took < 2 * TIMEOUT + ROOM
        device.frozen = False
        await until(lambda: link.status.state is not LinkState.DOWN)
        for _ in range(3):
            samples = await link.read(names)
        assert all(s.good for s in samples.values())


async def test_writing_to_a_quarantined_unit_fails_without_waiting() -> None:
    channels = three_units()
    device = TcpDevice(Memory(units=(1, 2, 3)))
    async with device, linked(device.port, channels, quarantine_max=30.0, timeout=0.4) as link:
        device.memory.silent = {1}
        for _ in range(2):
            with pytest.raises(LinkTimeoutError, match="not written: out: no answer from unit 1"):
                await link.write({"out": 1})
            await link.read(("u2_0",))
        began = time.monotonic()
        with pytest.raises(LinkTimeoutError, match="asked again in"):
            await link.write({"out": 1})
        assert time.monotonic() - began < 0.4


async def test_a_gateway_that_reports_a_dead_unit_is_quarantine_not_outage() -> None:
    device = TcpDevice()
    async with device, linked(device.port, ONE_UNIT) as link:
        device.memory.forbidden = lambda request: 11
        for _ in range(5):
            samples = await link.read(("enc",))
        assert samples["enc"].quality is Quality.UNAVAILABLE
        assert "gateway target does not answer" in samples["enc"].reason
        assert link.status.state is LinkState.DEGRADED
        assert device.connections == 1


async def test_a_device_that_hangs_up_at_every_request_is_not_besieged() -> None:
    async with TcpDevice() as device:
        device.tamper = lambda unit, pdu, frame: [-1.0]
        async with linked(device.port, ONE_UNIT, reconnect_min=0.05, reconnect_max=0.4):
            await asyncio.sleep(1.0)
        # 0.05, 0.1, 0.2, 0.4, 0.4, ... s apart, each times 0.5 to 1.
        assert 2 <= device.connections <= 9


async def test_a_device_that_answers_once_and_hangs_up_is_not_besieged() -> None:
    async with TcpDevice() as device:
        device.tamper = lambda unit, pdu, frame: [frame, -1.0]
        async with linked(device.port, ONE_UNIT, reconnect_min=0.05, reconnect_max=0.4) as link:
            await asyncio.sleep(1.0)
            assert link.status.reconnects > 0
        assert 2 <= device.connections <= 9


def test_quarantine_doubles_up_to_its_limit() -> None:
    config = ModbusConfig.model_validate(
        {"host": "h", "timeout": 0.5, "quarantine_after": 3, "quarantine_max": 6.0}
        | {"channels": ONE_UNIT, "blocks": {"slow": {}}}
    )
    unit = Unit(1, ())
    waits = []
    for _ in range(2000):
        unit.unanswered(100.0, "no answer", config)
        waits.append(unit.retry_at - 100.0)
    assert waits[:8] == [0.0, 0.0, 1.0, 2.0, 4.0, 6.0, 6.0, 6.0]
    assert waits[-1] == 6.0
    unit.answered()
    unit.unanswered(100.0, "no answer", config)
    assert unit.retry_at == 100.0
