"""CANopen nodes over a simulated slcan adapter in its own process: values, SYNC, tables."""

from __future__ import annotations

import asyncio
import random
import re
import zlib
from collections.abc import Iterator
from typing import Any

import pytest

from abbe.drivers.link import LinkConfigError, LinkError, LinkProtocolError, LinkState, Quality
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.can.canopen_links import (
    APART,
    AXES,
    BY_PDO,
    BY_SDO,
    CONTROLLER,
    ENCODER_NODES,
    INPUTS,
    THERMOMETER,
    linked,
)
from tests.support.drivers.can.links import STALL, all_good
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can") as process:
        yield process


async def test_encoders_by_sdo(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_SDO) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        first = await link.read(AXES)
        assert all(s.good for s in first.values())
        # asked one after the other: each axis is within its own half million counts
        assert [int(first[a].value // APART) for a in AXES] == [1, 2, 3]
        await asyncio.sleep(0.01)
        second = await link.read(AXES)
        assert all(second[a].value != first[a].value for a in AXES)
        assert link.channels["x"].startswith("node x (3) 6004h:00, int32 by SDO")
        heartbeats = bus.order("report")["heartbeats"]
        assert [heartbeats[n] for n in ("3", "4", "5", "6")] == [0.05, 0.05, 0.05, 0.0]


async def test_encoders_by_pdo_at_one_sync_belong_to_one_moment(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
        assert link.status.state is LinkState.UP, link.status.detail
        seen = set()
        for _ in range(20):
            samples = await link.read(AXES)
            assert all(s.good for s in samples.values()), samples
            x, y, z = (samples[a].value for a in AXES)
            # the simulated encoders latch at the same SYNC: not a count of motion in between
            assert (y - x, z - x) == (APART, 2 * APART)
            seen.add(x)
        assert len(seen) > 10
        assert link.channels["x"].endswith("int32 by PDO at SYNC, in count")


async def test_heartbeats_while_nodes_are_set_up_do_not_set_them_up_twice(
    bus: SimulatedProcess,
) -> None:
    """A second time would begin while a SYNC is out, and miss its answers."""
    for _ in range(5):
        async with linked(bus.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
            pdos = [node.pdos for node in link._bus.nodes.values()]
            for _ in range(15):
                assert all(s.good for s in (await link.read(AXES)).values())
            assert [node.pdos for node in link._bus.nodes.values()] == pdos


async def test_encoders_that_send_by_themselves() -> None:
    with SimulatedProcess("can", "--event", "0.02") as own:
        channels = {axis: section | {"within": STALL} for axis, section in BY_PDO.items()}
        async with linked(own.ready, ENCODER_NODES, channels) as link:
            first = await all_good(link, AXES)

            async def all_later() -> bool:
                return all(s.time > first[a].time for a, s in (await link.read(AXES)).items())

            await until(all_later)
            own.order("node", number=4, silent=True)

            async def y_is_gone() -> bool:
                samples = await link.read(AXES)
                return samples["x"].good and not samples["y"].good

            await until(y_is_gone)


async def test_a_sync_of_our_own_pace(bus: SimulatedProcess) -> None:
    channels = {axis: section | {"within": STALL} for axis, section in BY_PDO.items()}
    async with linked(bus.ready, ENCODER_NODES, channels, sync=0.02) as link:
        first = await all_good(link, AXES)

        async def later() -> bool:
            return (await link.read(AXES))["z"].time > first["z"].time

        await until(later)


async def test_temperature_inputs_with_the_device_s_decimals(bus: SimulatedProcess) -> None:
    bus.order("temperature", values=[20.0, 21.25, 22.5, -3.75])
    async with linked(bus.ready, THERMOMETER, INPUTS) as link:
        samples = await link.read(tuple(INPUTS))
        assert [s.value for s in samples.values()] == pytest.approx([20.0, 21.25, 22.5, -3.75])
    for kind in ("int16", "float32"):
        inputs = {"T2": INPUTS["T2"] | {"type": kind, "scale": 1000.0, "unit": ""}}
        async with linked(bus.ready, THERMOMETER, inputs) as link:
            assert (await link.read(("T2",)))["T2"].value == pytest.approx(21250.0)


async def test_temperature_inputs_that_share_a_pdo(bus: SimulatedProcess) -> None:
    """Four 16-bit values in one frame, each with its own decimals."""
    bus.order("temperature", values=[20.0, 21.25, 22.5, -3.75])
    inputs = {name: section | {"type": "int16", "by": "pdo"} for name, section in INPUTS.items()}
    async with linked(bus.ready, THERMOMETER, inputs, sync="read") as link:
        before = link.status.requests
        samples = await link.read(tuple(INPUTS))
        assert [s.value for s in samples.values()] == pytest.approx([20.0, 21.25, 22.5, -3.75])
        assert link.status.requests == before + 1
    wrong = {"T1": inputs["T1"] | {"type": "int32"}}
    async with linked(bus.ready, THERMOMETER, wrong, sync="read") as link:
        sample = (await link.read(("T1",)))["T1"]
        assert "object 9130h:01 is in none of the node's TPDOs (TPDO1: 7130h:01" in sample.reason


async def test_a_pdo_that_does_not_answer_every_sync(bus: SimulatedProcess) -> None:
    bus.order("node", number=4, transmission=3)
    try:
        async with linked(bus.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
            samples = await link.read(AXES)
            assert [s.good for s in samples.values()] == [True, False, True]
            assert (
                "no TPDO with 6004h:00 answers every SYNC: its transmission type would be 1, "
                "that of TPDO1 is 254, that of TPDO2 is 3"
            ) in samples["y"].reason
        channels = {"y": BY_PDO["y"] | {"within": STALL}}
        async with linked(bus.ready, ENCODER_NODES, channels, sync=0.02) as link:
            await all_good(link, ("y",))
    finally:
        bus.order("node", number=4, transmission=1)


async def test_slow_objects_keep_their_value_and_its_time(bus: SimulatedProcess) -> None:
    bus.order("temperature", values=[20.0, 21.25, 22.5, -3.75])
    inputs = {"T1": INPUTS["T1"] | {"every": 30.0}, "T2": INPUTS["T2"]}
    async with linked(bus.ready, THERMOMETER, inputs) as link:
        first = await link.read(("T1", "T2"))
        bus.order("temperature", values=[30.0, 31.0, 0.0, 0.0])
        second = await link.read(("T1", "T2"))
        assert [s.value for s in second.values()] == [20.0, 31.0]
        assert second["T1"].time == first["T1"].time
        assert link.info("T1").every == 30.0


@pytest.mark.parametrize(
    ("channel", "wrong"),
    [
        (
            {"profile": "cia406"},
            r"not an encoder \(CiA 406\): its device type .1000h. is 00020194h",
        ),
        (
            {"profile": "cia404", "input": 1, "unit": "ohm"},
            "unit is 'ohm', the device measures in degC",
        ),
        ({"profile": "cia404", "input": 9}, "6131h:09 of node 6: refused, .*0x06020000"),
        ({"index": 0x6004, "type": "int32"}, "6004h:00 of node 6: refused"),
        ({"index": 0x1000, "type": "int16"}, "4 bytes came, int16 has 2"),
        (
            {"index": 0x6130, "subindex": 1, "type": "float32", "by": "pdo"},
            "in none of the node's TP",
        ),
    ],
)
async def test_what_a_node_does_not_have_is_bad_and_says_why(
    bus: SimulatedProcess, channel: dict[str, Any], wrong: str
) -> None:
    channels = {"odd": {"node": "t"} | channel, "T1": INPUTS["T1"]}
    async with linked(bus.ready, THERMOMETER, channels) as link:
        samples = await link.read(("odd", "T1"))
        assert samples["T1"].good
        assert samples["odd"].quality is Quality.BAD
        assert re.search(wrong, samples["odd"].reason), samples["odd"].reason


async def test_objects_are_written_and_verified(bus: SimulatedProcess) -> None:
    offset = {"node": "mill", "index": 0x2200, "subindex": 1, "type": "int32", "scale": 0.001}
    channels = {
        "offset": offset | {"writable": True, "verify": True, "unit": "mm"},
        "length": {"node": "mill", "index": 0x2101, "type": "uint32", "writable": True},
    }
    async with linked(bus.ready, CONTROLLER, channels) as link:
        await link.write({"offset": -12.345})
        assert bus.order("report")["offset"] == -12345
        assert (await link.read(("offset",)))["offset"].value == pytest.approx(-12.345)
        with pytest.raises(LinkError, match="nothing written; offset: .* does not fit int32"):
            await link.write({"offset": 1e9})
        with pytest.raises(
            LinkProtocolError, match="not written: length: 2101h:00 of node 16: ref"
        ):
            await link.write({"offset": 1.0, "length": 5})
        assert bus.order("report")["offset"] == 1000


def table(size: int) -> bytes:
    return random.Random(size).randbytes(size)


@pytest.mark.parametrize("size", [4, 7, 8, 224, 1000, 20_000])
async def test_a_table_goes_by_block_transfer(bus: SimulatedProcess, size: int) -> None:
    data = table(size - size % 4)
    async with linked(bus.ready, CONTROLLER, {}) as link:
        assert await link.download("mill", 0x2100, 0, data)
        report = bus.order("report")
        assert (report["table_length"], report["table_crc32"]) == (len(data), zlib.crc32(data))
        assert await link.upload("mill", 0x2100, 0) == data


@pytest.mark.parametrize(
    ("fault", "arrives"),
    [
        ({"lose": [5]}, True),
        ({"lose": [40, 41, 77]}, True),
        ({"lose": [143]}, False),  # the last segment: nobody can know
        ({"hang_after": 50}, False),
        ({"spoil": True}, False),
        ({"refused": True}, True),  # in segments then
    ],
)
async def test_a_table_arrives_whole_or_not_at_all(fault: dict[str, Any], arrives: bool) -> None:
    before, data = table(400), table(1000)
    with SimulatedProcess("can") as own:
        async with linked(own.ready, CONTROLLER | THERMOMETER, INPUTS) as link:
            await link.download("mill", 0x2100, 0, before)
            own.order("block", **fault)
            if arrives:
                assert await link.download("mill", 0x2100, 0, data) is not fault.get("refused")
            else:
                with pytest.raises(LinkError, match="2100h:00 of node 16"):
                    await link.download("mill", 0x2100, 0, data)
            held = own.order("report")["table_crc32"]
            assert held == zlib.crc32(data if arrives else before)
            own.order("block")

            async def succeeds() -> bool:
                try:
                    return await link.download("mill", 0x2100, 0, data)
                except LinkError:
                    return False

            await until(succeeds)
            assert await link.upload("mill", 0x2100, 0) == data
            assert (await link.read(("T1",)))["T1"].good


async def test_the_others_are_read_while_a_table_is_sent(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, CONTROLLER | THERMOMETER, INPUTS) as link:
        sending = asyncio.create_task(link.download("mill", 0x2100, 0, table(20_000)))
        reads = 0
        while not sending.done():
            assert all(s.good for s in (await link.read(("T1", "T2"))).values())
            reads += 1
        assert await sending
        assert reads > 5


async def test_names_that_do_not_exist(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, THERMOMETER, INPUTS) as link:
        with pytest.raises(LinkConfigError, match="no channel 'u'; there are: T1"):
            await link.read(("u",))
        with pytest.raises(LinkConfigError, match="no node 'mill'; there are: t"):
            await link.download("mill", 0x2100, 0, b"1234")
