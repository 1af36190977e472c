"""The links over a second transport: python-can's udp_multicast, between processes.

It loses frames in bursts, as a bus never does: here at most some hundred a second, and what is lost
is asked for again.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from abbe.drivers.link import LinkError, LinkState, Quality
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
from tests.support.drivers.can.links import ASK_Z, READ, Z, all_good, free_port
from tests.support.drivers.can.links import linked as linked_messages
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

GROUP = "239.74.163.86"
PACE = 0.01
"""s between two polls."""


@pytest.fixture(scope="module")
def bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can", "--udp", f"{GROUP}:{free_port()}", "--frames", "0.02") as process:
        yield process


async def test_signals_and_requests(bus: SimulatedProcess) -> None:
    async with linked_messages(bus.ready, READ | Z, messages=ASK_Z) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        for _ in range(10):
            samples = await all_good(link, (*READ, "position_z"))
            assert samples["position_y"].value - samples["x"].value == pytest.approx(1000.0)
            await asyncio.sleep(PACE)


async def test_encoders_by_pdo_and_by_sdo(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
        assert link.status.state is LinkState.UP, link.status.detail
        for _ in range(10):
            samples = await all_good(link, AXES)
            x, y, z = (samples[a].value for a in AXES)
            assert (y - x, z - x) == (APART, 2 * APART)
            await asyncio.sleep(PACE)
    async with linked(bus.ready, ENCODER_NODES, BY_SDO) as link:
        for _ in range(10):
            await all_good(link, AXES)
            await asyncio.sleep(PACE)


async def test_temperatures_and_a_table(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, THERMOMETER | CONTROLLER, INPUTS) as link:
        samples = await all_good(link, tuple(INPUTS))
        assert samples["T2"].value == pytest.approx(21.25)
        data = bytes(range(200))

        async def sent() -> bool:
            try:
                return await link.download("mill", 0x2100, 0, data)
            except LinkError:
                return False

        await until(sent)
        assert await link.upload("mill", 0x2100, 0) == data


async def test_a_missing_heartbeat_and_an_emergency(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_SDO) as link:
        await all_good(link, AXES)
        bus.order("emergency", number=3, code=0x5530, register=0x81)
        bus.order("node", number=4, silent=True)
        await until(lambda: "emergency 5530h" in link.status.detail)
        await until(lambda: list(link.status.quarantined) == ["node y (4)"])
        samples = await link.read(AXES)
        assert [s.quality for s in samples.values()] == [
            Quality.BAD,
            Quality.UNAVAILABLE,
            Quality.GOOD,
        ]
        bus.order("emergency", number=3, code=0, register=0)
        bus.order("node", number=4, silent=False)
        await until(lambda: link.status.state is LinkState.UP)
        await all_good(link, AXES)
