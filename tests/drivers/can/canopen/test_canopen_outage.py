"""CANopen nodes that vanish, restart, report emergencies, answer late; adapters unplugged."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator

import pytest

from abbe.drivers.can.canopen.nodes.node import Node
from abbe.drivers.link import LinkDownError, LinkState, Quality
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.can.canopen_links import (
    APART,
    AXES,
    BY_PDO,
    BY_SDO,
    ENCODER_NODES,
    linked,
)
from tests.support.drivers.can.links import STALL, all_good
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


@pytest.fixture
def bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can") as process:
        yield process


async def test_a_node_without_heartbeat_is_set_apart_though_nobody_asks_it(
    bus: SimulatedProcess, caplog: pytest.LogCaptureFixture
) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_SDO) as link:
        assert link.status.state is LinkState.UP
        bus.order("node", number=4, silent=True)
        await until(lambda: link.status.state is LinkState.DEGRADED)
        assert "node y (4): no heartbeat for 1." in link.status.detail
        assert list(link.status.quarantined) == ["node y (4)"]
        asked = link.status.requests
        for _ in range(20):
            samples = await link.read(AXES)
            assert [name for name, s in samples.items() if not s.good] == ["y"]
            assert "no heartbeat" in samples["y"].reason or "no answer" in samples["y"].reason
        # it costs the others nothing: nobody waited for it
        assert link.status.requests == asked + 2 * 20
        bus.order("node", number=4, silent=False)
        await all_good(link, AXES)
        await until(lambda: link.status.state is LinkState.UP)
    said = [r.getMessage() for r in caplog.records if "node y" in r.getMessage()]
    assert ["set apart" in said[0], "answers again" in said[-1], len(said)] == [True, True, 2]


async def test_a_stopped_heart_alone_is_enough(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_SDO) as link:
        bus.order("node", number=3, heart_stopped=True)
        await until(lambda: "node x (3)" in link.status.quarantined)
        # it answers all the same, and stays apart
        await until(lambda: "no heartbeat comes from it in 1.5 s" in link.status.detail)
        assert list(link.status.quarantined) == ["node x (3)"]
        assert (await link.read(("x",)))["x"].quality is Quality.UNAVAILABLE
        bus.order("node", number=3, heart_stopped=False)
        await all_good(link, AXES)


async def test_a_node_that_restarts_is_set_up_again(
    bus: SimulatedProcess, caplog: pytest.LogCaptureFixture
) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
        await all_good(link, AXES)
        bus.order("boot", number=5)
        await until(lambda: "restarted" in caplog.text)
        await all_good(link, AXES)
        report = bus.order("report")
        assert report["heartbeats"]["5"] == 0.05
        assert report["states"]["5"] == 5


async def test_an_emergency_makes_a_node_s_values_bad(bus: SimulatedProcess) -> None:
    nodes = ENCODER_NODES | {"y": ENCODER_NODES["y"] | {"emergency": "report"}}
    async with linked(bus.ready, nodes, BY_SDO) as link:
        bus.order("emergency", number=3, code=0x5530, register=0x81)
        bus.order("emergency", number=4, code=0x8110, register=0x11)
        await until(lambda: "emergency 8110h" in link.status.detail)
        assert link.status.state is LinkState.DEGRADED
        assert "node x (3): emergency 5530h, device hardware; error register 81h" in (
            link.status.detail
        )
        samples = await link.read(AXES)
        assert samples["x"].quality is Quality.BAD
        assert "5530h" in samples["x"].reason
        assert samples["y"].good
        assert samples["z"].good
        # 00xxh: error reset
        bus.order("emergency", number=3, code=0x0010, register=0)
        bus.order("emergency", number=4, code=0, register=0)
        await until(lambda: link.status.state is LinkState.UP)
        await all_good(link, ("x",))


async def test_a_node_that_was_absent_is_found_when_it_boots(bus: SimulatedProcess) -> None:
    bus.order("node", number=4, silent=True)
    async with linked(bus.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
        assert link.status.state is LinkState.DEGRADED
        samples = await link.read(AXES)
        assert [name for name, s in samples.items() if not s.good] == ["y"]
        bus.order("node", number=4, silent=False)
        bus.order("boot", number=4)
        await all_good(link, AXES)


async def test_no_node_at_all_is_down(bus: SimulatedProcess) -> None:
    for number in (3, 4, 5):
        bus.order("node", number=number, silent=True)
    async with linked(bus.ready, ENCODER_NODES, BY_SDO) as link:
        assert link.status.state is LinkState.DOWN
        assert "the interface is open, and no node answers" in link.status.detail
        bus.order("node", number=3, silent=False)
        await until(lambda: link.status.state is not LinkState.DOWN)
        await all_good(link, ("x",))


async def test_a_node_whose_heartbeat_cannot_be_set_is_used_and_says_so(
    bus: SimulatedProcess,
) -> None:
    bus.order("node", number=4, heartbeat_fixed=True)
    nodes = ENCODER_NODES | {"y": {"id": 4, "produce_heartbeat": 0.05}}
    async with linked(bus.ready, nodes, BY_SDO) as link:
        assert link.status.state is LinkState.DEGRADED
        assert "node y (4), its heartbeat cannot be set: 1017h:00 of node 4: refused" in (
            link.status.detail
        )
        await all_good(link, AXES)


async def test_a_watch_that_fails_is_an_outage_not_silence(
    bus: SimulatedProcess, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_SDO) as link:
        with monkeypatch.context() as patch:
            patch.setattr(Node, "fell_back", lambda self: 1 / 0)
            await until(lambda: "watching its nodes failed" in caplog.text)
        await until(lambda: link.status.state is LinkState.UP)
        assert link.status.reconnects >= 1
        await all_good(link, AXES)


@pytest.mark.parametrize("how", ["unplug", "reset_adapter", "break"])
async def test_an_adapter_lost_and_found(bus: SimulatedProcess, how: str) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
        await all_good(link, AXES)
        bus.order(how)
        await until(lambda: link.status.state is LinkState.DOWN)
        samples = await link.read(AXES)
        assert all(s.quality is Quality.UNAVAILABLE for s in samples.values())
        with pytest.raises(LinkDownError):
            await link.upload("x", 0x1000, 0)
        if how == "unplug":
            bus.order("plug")
        elif how == "break":
            bus.order("mend")
        await all_good(link, AXES)
        assert link.status.reconnects >= 1


async def test_a_late_sdo_answer_is_never_taken_for_the_next_one(bus: SimulatedProcess) -> None:
    """The encoder moves by 100 counts a millisecond: an old position would be seen."""
    nodes = {"x": {"id": 3}}
    async with linked(
        bus.ready, nodes, {"x": BY_SDO["x"]}, timeout=0.15, quarantine_after=100
    ) as link:
        await all_good(link, ("x",))
        bus.order("node", number=3, late=0.25)
        assert not (await link.read(("x",)))["x"].good
        bus.order("node", number=3, late=0.0)
        good = 0
        while good < 10:
            began = time.monotonic()
            sample = (await link.read(("x",)))["x"]
            if sample.good:
                good += 1
                # by the machine's clock, which the simulated encoder counts too
                oldest = APART + int(began * 100_000) % 500_000
                moved = (sample.value - oldest) % 500_000
                assert moved < 100_000 * (time.monotonic() - began) + 2_000


async def test_a_missing_answer_to_sync_costs_that_node_only(bus: SimulatedProcess) -> None:
    nodes = {axis: {"id": node["id"]} for axis, node in ENCODER_NODES.items()}
    async with linked(bus.ready, nodes, BY_PDO, sync="read", late_reply_max=60.0) as link:
        await all_good(link, AXES)
        bus.order("node", number=5, silent=True)
        samples = await link.read(AXES)
        assert [name for name, s in samples.items() if not s.good] == ["z"]
        assert "did not answer SYNC" in samples["z"].reason
        # until a late answer can come no more, it is not waited for: the others are quick
        began = time.monotonic()
        for _ in range(20):
            assert (await link.read(AXES))["x"].good
        assert time.monotonic() - began < 20 * STALL / 2


async def test_a_node_answers_sync_again(bus: SimulatedProcess) -> None:
    nodes = {axis: {"id": node["id"]} for axis, node in ENCODER_NODES.items()}
    async with linked(
        bus.ready, nodes, BY_PDO, sync="read", timeout=0.2, late_reply_max=0.2
    ) as link:
        # started: the order to fall silent goes another way than the order to start
        await all_good(link, AXES)
        bus.order("node", number=5, silent=True)
        assert not (await link.read(AXES))["z"].good
        bus.order("node", number=5, silent=False)
        await all_good(link, AXES)


async def test_closing_ends_what_is_under_way(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, ENCODER_NODES, BY_SDO, timeout=60.0) as link:
        bus.order("node", number=3, late=60.0)
        call = asyncio.create_task(link.read(("x",)))
        await asyncio.sleep(0.05)
        await link.close()
        sample = (await asyncio.wait_for(call, 30.0))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert link.status.state is LinkState.CLOSED
