"""When a refused request is divided, and when not: on devices that refuse for ever, or briefly."""

from __future__ import annotations

import asyncio
import time
from typing import Any

import pytest

from abbe.drivers.link import LinkConfigError, LinkError, Quality, TooLateError
from abbe.drivers.modbus import dividing
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.link import ModbusLink
from tests.support.drivers.modbus_devices import Request, TcpDevice

EIGHT = {f"c{i}": {"table": "input", "address": i, "type": "int16"} for i in range(8)}
NAMES = tuple(EIGHT)


async def linked(device: TcpDevice, channels: dict[str, Any], **settings: Any) -> ModbusLink:
    section = {"host": "127.0.0.1", "port": device.port, "timeout": 0.5, "channels": channels}
    link = ModbusLink("cmm", ModbusConfig.model_validate(section | settings))
    await link.open()
    return link


def lacks(address: int) -> Any:
    return lambda r: 2 * (r.address <= address < r.address + r.count)


async def requests_of(link: ModbusLink, device: TcpDevice, names: tuple[str, ...]) -> int:
    before = len(device.memory.requests)
    await link.read(names)
    return len(device.memory.requests) - before


@pytest.mark.parametrize("answered_before", [True, False])
async def test_a_burst_of_refusals_leaves_nothing_behind(answered_before: bool) -> None:
    async with TcpDevice() as device:
        link = await linked(device, EIGHT)
        if answered_before:
            await link.read(NAMES)
        device.memory.forbidden = lambda r: 2
        end = time.monotonic() + 0.2
        while time.monotonic() < end:
            samples = await link.read(NAMES)
            assert {s.quality for s in samples.values()} == {Quality.BAD}
        device.memory.forbidden = lambda r: 0
        assert all(s.good for s in (await link.read(NAMES)).values())
        assert await requests_of(link, device, NAMES) == 1
        await link.close()


async def test_a_burst_that_ends_while_the_parts_are_tried_divides_nothing() -> None:
    async with TcpDevice() as device:
        link = await linked(device, EIGHT)
        left = 2

        def refuse(request: Request) -> int:
            nonlocal left
            left -= 1
            return 2 * (left >= 0)

        device.memory.forbidden = refuse
        await link.read(NAMES)
        assert await requests_of(link, device, NAMES) == 1
        await link.close()


async def test_the_whole_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dividing, "_FIRST_TRIAL", 0.05)
    async with TcpDevice() as device:
        device.memory.forbidden = lacks(5)
        link = await linked(device, EIGHT)
        await link.read(NAMES)
        samples = await link.read(NAMES)
        assert [n for n, s in samples.items() if not s.good] == ["c5"]
        device.memory.forbidden = lambda r: 0
        end = time.monotonic() + 10.0
        while await requests_of(link, device, NAMES) != 1:
            assert time.monotonic() < end
            await asyncio.sleep(0.01)
        assert all(s.good for s in (await link.read(NAMES)).values())
        await link.close()


async def test_what_is_of_one_moment_is_never_divided() -> None:
    async with TcpDevice() as device:
        device.memory.forbidden = lacks(3)
        link = await linked(device, EIGHT)
        link.keep_together(("c1", "c2", "c4"), one_sample=True)
        for _ in range(3):
            samples = await link.read(NAMES)
        assert [n for n, s in samples.items() if not s.good] == ["c1", "c2", "c3", "c4"]
        await link.close()


async def test_what_cannot_be_of_one_moment_is_refused() -> None:
    channels = EIGHT | {"far": {"table": "input", "address": 200, "type": "int16"}}
    async with TcpDevice() as device:
        link = await linked(device, channels)
        link.keep_together(("c1", "far"))
        with pytest.raises(LinkConfigError, match="need 2: .* max_gap = 8"):
            link.keep_together(("c1", "far"), one_sample=True)
        await link.close()


async def test_a_late_answer_is_as_old_as_its_question() -> None:
    async with TcpDevice() as device:
        link = await linked(device, EIGHT)
        device.tamper = lambda unit, pdu, frame: [0.2, frame]
        asked = time.monotonic()
        sample = (await link.read(("c1",)))["c1"]
        assert sample.good
        assert asked <= sample.time < asked + 0.1
        assert sample.age() >= 0.2
        await link.close()


OUT = {
    "out": {"table": "holding", "address": 10, "type": "int32", "writable": True},
    "beat": {"table": "holding", "address": 20, "type": "int16", "writable": True},
    "in": {"table": "holding", "address": 40, "type": "int16"},
}


async def test_nothing_leaves_after_its_time() -> None:
    async with TcpDevice() as device:
        link = await linked(device, OUT)
        device.tamper = lambda unit, pdu, frame: [0.2, frame]
        read = asyncio.create_task(link.read(("in",)))
        await asyncio.sleep(0.05)
        with pytest.raises(TooLateError) as caught:
            await link.write({"out": 1.0}, until=time.monotonic() + 0.05)
        assert caught.value.untouched == {"out"}
        await read
        assert [r.function for r in device.memory.requests if r.function > 4] == []
        await link.close()


@pytest.mark.parametrize(("code", "untouched"), [(1, {"beat"}), (2, {"beat"}), (4, set())])
async def test_a_refused_write_says_what_became_of_each(code: int, untouched: set[str]) -> None:
    async with TcpDevice() as device:
        link = await linked(device, OUT)
        device.memory.forbidden = lambda r: code * (r.address == 20)
        with pytest.raises(LinkError) as caught:
            await link.write({"out": 1.0, "beat": 2.0})
        assert caught.value.written == {"out"}
        assert caught.value.untouched == untouched
        await link.close()


async def test_a_silent_device_leaves_unknown_what_was_sent_and_untouched_what_was_not() -> None:
    async with TcpDevice() as device:
        link = await linked(device, OUT)
        device.memory.silent = {1}
        with pytest.raises(LinkError) as caught:
            await link.write({"out": 1.0, "beat": 2.0})
        assert (caught.value.written, caught.value.untouched) == (frozenset(), {"beat"})
        await link.close()
