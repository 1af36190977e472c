"""Modbus RTU over a real pseudo-terminal: values, several units, silence, echo, lost ports."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.pdu import DecodePDU

from abbe.drivers.link import LinkState, LinkTimeoutError, Quality
from abbe.drivers.modbus.bus.framing import StrictRtuFramer
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.link import ModbusLink
from tests.support.drivers.modbus_devices import Memory, RtuDevice, crc

CHANNELS: dict[str, dict[str, Any]] = {
    "enc": {"table": "input", "address": 10, "type": "int32"},
    "bit": {"table": "discrete", "address": 3},
    "coil": {"table": "coil", "address": 4, "writable": True, "verify": True},
    "word": {"table": "holding", "address": 5, "type": "int16", "writable": True, "verify": True},
    "out": {"table": "holding", "address": 6, "type": "float32", "writable": True, "verify": True},
}


@asynccontextmanager
async def linked(
    path: str, channels: dict[str, dict[str, Any]], **settings: Any
) -> AsyncIterator[ModbusLink]:
    section = {
        "transport": "rtu",
        "port": path,
        "baudrate": 115200,
        "reconnect_min": 0.02,
        "reconnect_max": 0.1,
        "channels": channels,
    }
    link = ModbusLink("bench", ModbusConfig.model_validate(section | settings))
    await link.open()
    try:
        yield link
    finally:
        await link.close()


@pytest.mark.parametrize("echo", [False, True])
async def test_reading_and_writing_every_table(echo: bool) -> None:
    with RtuDevice(echo=echo) as device:
        async with linked(device.path, CHANNELS, local_echo=echo) as link:
            samples = await link.read(tuple(CHANNELS))
            assert {n: s.value for n, s in samples.items()} == {
                "enc": (10 << 16) + 11,
                "bit": 1.0,
                "coil": 0.0,
                "word": 5.0,
                "out": samples["out"].value,
            }
            await link.write({"coil": 1, "word": -2, "out": 2.5})
            await link.write({"word": -7})
            samples = await link.read(("coil", "word", "out"))
            assert [s.value for s in samples.values()] == [1.0, -7.0, 2.5]
            assert link.status.state is LinkState.UP


async def test_with_local_echo_the_echo_of_a_write_is_no_confirmation() -> None:
    channels = {"word": {"table": "holding", "address": 5, "type": "int16", "writable": True}}
    with RtuDevice(echo=True) as device:
        for local_echo in (True, False):
            async with linked(device.path, channels, timeout=0.5, local_echo=local_echo) as link:
                assert link.status.state is LinkState.UP
                device.memory.silent = {1}
                if local_echo:
                    with pytest.raises(LinkTimeoutError):
                        await link.write({"word": 1})
                else:
                    # The request and its confirmation are the same bytes: hence the setting.
                    await link.write({"word": 1})
                device.memory.silent = set()


async def test_one_dead_unit_among_three_on_a_serial_line() -> None:
    channels = {
        f"u{unit}": {"table": "input", "address": unit, "type": "int32", "unit_id": unit}
        for unit in (1, 2, 3)
    }
    with RtuDevice(Memory(units=(1, 2, 3))) as device:
        async with linked(device.path, channels, timeout=1.5, quarantine_max=2.0) as link:
            device.memory.silent = {2}
            for _ in range(40):
                samples = await link.read(tuple(channels))
                bad = {n: s.reason for n, s in samples.items() if not s.good}
                assert list(bad) == ["u2"], bad
                assert samples["u1"].value == (1 << 16) + 2
                assert samples["u3"].value == (3 << 16) + 4
                await asyncio.sleep(0.01)
            assert link.status.state is LinkState.DEGRADED
            assert len([r for r in device.memory.requests if r.unit == 2]) < 10
            device.memory.silent = set()
            deadline = time.monotonic() + 30.0
            while not (sample := (await link.read(("u2",)))["u2"]).good:
                assert time.monotonic() < deadline
                await asyncio.sleep(0.02)
            assert sample.value == (2 << 16) + 3


async def test_one_lost_answer_costs_one_reading() -> None:
    with RtuDevice() as device:
        async with linked(device.path, CHANNELS, timeout=0.4, quarantine_after=3) as link:
            device.memory.silent = {1}
            assert not (await link.read(("enc",)))["enc"].good
            device.memory.silent = set()
            assert (await link.read(("enc",)))["enc"].good


async def test_the_time_on_the_wire_comes_on_top_of_the_timeout() -> None:
    # 100 registers at 2400 bit/s, 10 bits a character: 8 + 205 characters take 0.89 s.
    channels = {f"c{i}": {"table": "input", "address": i, "type": "int16"} for i in range(100)}
    with RtuDevice() as device:
        device.delay = lambda request: 1.2 if request.count == 100 else 0.0
        async with linked(device.path, channels, baudrate=2400, timeout=0.8) as link:
            assert all(s.good for s in (await link.read(tuple(channels))).values())


async def test_the_line_is_silent_between_frames() -> None:
    channels = {
        "a": {"table": "input", "address": 0, "type": "int16"},
        "b": {"table": "holding", "address": 0, "type": "int16"},
    }
    with RtuDevice() as device:
        async with linked(device.path, channels, pause=0.05) as link:
            began = time.monotonic()
            for _ in range(3):
                assert all(s.good for s in (await link.read(("a", "b"))).values())
            assert time.monotonic() - began >= 5 * 0.05


async def test_a_port_that_does_not_exist_is_reported_and_retried() -> None:
    async with linked("/dev/abbe-no-such-port", CHANNELS) as link:
        assert link.status.state is LinkState.DOWN
        assert "No such file" in link.status.detail
        sample = (await link.read(("enc",)))["enc"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "/dev/abbe-no-such-port" in sample.reason


async def test_a_port_that_vanishes_and_returns(tmp_path: Any) -> None:
    stable = tmp_path / "ttyABBE"
    device = RtuDevice()
    stable.symlink_to(device.path)
    async with linked(str(stable), CHANNELS, timeout=0.5) as link:
        deadline = time.monotonic() + 60.0
        while not (await link.read(("enc",)))["enc"].good:
            assert time.monotonic() < deadline
        stable.unlink()
        device.__exit__()
        while link.status.state is not LinkState.DOWN:
            assert time.monotonic() < deadline
            await asyncio.sleep(0.01)
        assert not (await link.read(("enc",)))["enc"].good
        with RtuDevice() as again:
            stable.symlink_to(again.path)
            while not (await link.read(("enc",)))["enc"].good:
                assert time.monotonic() < deadline
                await asyncio.sleep(0.02)


async def test_a_second_link_on_the_same_port_is_refused_with_the_reason() -> None:
    with RtuDevice() as device:
        async with linked(device.path, CHANNELS), linked(device.path, CHANNELS) as second:
            assert second.status.state is LinkState.DOWN
            assert "lock" in second.status.detail


# The framer, alone.


def answer(unit: int, pdu: bytes) -> bytes:
    body = bytes((unit,)) + pdu
    return body + crc(body)


def framer(unit: int = 7) -> StrictRtuFramer:
    made = StrictRtuFramer(DecodePDU(False))
    made.expect(unit, b"\x03\x04", 6)
    return made


WANTED = b"\x03\x04\x12\x34\x56\x78"


@given(st.binary(max_size=40), st.binary(max_size=40), st.integers(0, 50))
def test_the_answer_is_found_between_any_bytes_and_in_any_pieces(
    before: bytes, behind: bytes, cut: int
) -> None:
    frame = answer(7, WANTED)
    data = before + frame + behind
    used, unit, _, found = framer().decode(data)
    assert (unit, found) == (7, WANTED)
    assert data[:used].endswith(frame)
    part = data[: min(cut, len(before) + len(frame) - 1)]
    assert framer().decode(part) == (0, 0, 0, b"")


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=20),
            st.builds(answer, st.integers(0, 255), st.binary(min_size=1, max_size=12)),
        ),
        max_size=6,
    )
)
def test_nothing_else_is_ever_taken_for_the_answer(pieces: list[bytes]) -> None:
    _, unit, _, found = framer().decode(b"".join(pieces))
    if found:
        assert unit == 7
        assert (found[:2] == b"\x03\x04" and len(found) == 6) or (
            found[:1] == b"\x83" and len(found) == 2
        )


@pytest.mark.parametrize(
    "foreign",
    [
        answer(8, WANTED),
        answer(7, b"\x04" + WANTED[1:]),
        answer(7, b"\x03\x02\x12\x34"),
        answer(7, b"\x03\x06" + bytes(6)),
        answer(7, b"\x84\x02"),
        answer(7, b"\x10\x00\x64\x00\x02"),
        answer(7, WANTED)[:-1] + b"\x00",
    ],
)
def test_an_answer_of_another_unit_function_size_or_with_a_wrong_checksum(foreign: bytes) -> None:
    assert framer().decode(foreign) == (0, 0, 0, b"")
    assert framer().decode(foreign + answer(7, WANTED))[3] == WANTED


def test_an_exception_of_the_function_asked_is_an_answer() -> None:
    assert framer().decode(answer(7, b"\x83\x02"))[3] == b"\x83\x02"
