"""The bus under the links: receive errors, error frames, bus-off, another transport."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Iterator
from typing import Any

import can
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus
from can_links import ASK_Z, DBC, QUICK, READ, Z, interface, linked, until
from canopen_links import AXES, BY_PDO, ENCODER_NODES
from canopen_links import linked as linked_nodes

from drivers.can.dbc_config import DbcConfig
from drivers.can.dbc_link import DbcLink
from drivers.can.error_frames import told
from drivers.link import LinkState, Quality
from drivers.simulated.process import SimulatedProcess

pytestmark = pytest.mark.integration

GROUP = "239.74.163.87"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture(scope="module")
def udp() -> Iterator[SimulatedProcess]:
    """The same bus over python-can's udp_multicast, which carries error frames too."""
    with SimulatedProcess("can", "--udp", f"{GROUP}:{free_port()}", "--frames", "0.02") as process:
        yield process


# Another transport: lossy in bursts, so at most some hundred frames a second here


async def test_signals_over_udp_multicast(udp: SimulatedProcess) -> None:
    async with linked(udp.ready, READ | Z, messages=ASK_Z) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        for _ in range(10):
            samples = await link.read((*READ, "position_z"))
            assert all(s.good for s in samples.values())
            await asyncio.sleep(0.01)


async def test_nodes_over_udp_multicast(udp: SimulatedProcess) -> None:
    async with linked_nodes(udp.ready, ENCODER_NODES, BY_PDO, sync="read") as link:
        assert link.status.state is LinkState.UP, link.status.detail
        for _ in range(10):
            assert all(s.good for s in (await link.read(AXES)).values())
            await asyncio.sleep(0.01)


# Error frames


async def test_error_frames_are_reported_and_bus_off_is_an_outage(udp: SimulatedProcess) -> None:
    async with linked(udp.ready, READ) as link:
        udp.order("error_frame", id=0x04, data="0010000000000000")
        await until(lambda: link.status.state is LinkState.DEGRADED)
        assert link.status.detail == "receive error passive"
        assert (await link.read(("x",)))["x"].good
        udp.order("error_frame", id=0x04, data="0040000000000000")
        await until(lambda: link.status.state is LinkState.UP)
        udp.order("error_frame", id=0x40, data="0000000000000000")
        seen: list[str] = []

        async def down() -> bool:
            if link.status.state is LinkState.DOWN:
                seen.append(link.status.detail)
            return link.status.reconnects == 1

        await until(down)
        assert "bus-off" in seen[0]
        assert link.status.state is LinkState.UP


@pytest.mark.parametrize(
    ("identifier", "data", "words"),
    [
        (0x40, "00", "bus-off"),
        (0x20, "00", "nobody acknowledges"),
        (0x01, "00", "transmission timed out"),
        (0x0C, "0008000000000000", "warning level, protocol violation"),
        (0x04, "0003", "frames were lost, transmit buffer overflow"),
        (0x100, "", "controller restarted"),
        (0x800, "", "error frame 0x800"),
    ],
)
def test_error_frames_in_words(identifier: int, data: str, words: str) -> None:
    assert words in told(identifier, bytes.fromhex(data))


# Errors while receiving


class Broken:
    """Makes python-can's receiving fail from some moment on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = False
        receive = UdpMulticastBus._recv_internal

        def failing(bus: Any, timeout: float | None) -> Any:
            if self.now:
                raise can.CanOperationError("the interface went down")
            return receive(bus, timeout)

        monkeypatch.setattr(UdpMulticastBus, "_recv_internal", failing)


async def test_a_receive_error_is_an_outage_and_is_overcome(
    udp: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = Broken(monkeypatch)
    async with linked(udp.ready, READ) as link:
        assert (await link.read(("x",)))["x"].good
        broken.now = True
        await until(lambda: link.status.state is LinkState.DOWN)
        assert (await link.read(("x",)))["x"].quality is Quality.UNAVAILABLE
        broken.now = False
        await until(lambda: link.status.state is LinkState.UP)
        assert (await link.read(("x",)))["x"].good


async def test_python_can_s_notifier_would_die_silently(
    udp: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the test above guards against: the stock way to receive in asyncio."""
    broken = Broken(monkeypatch)
    complaints: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, what: complaints.append(what))
    frames: list[can.Message] = []
    section = interface(udp.ready)
    bus = can.Bus(
        interface=section["interface"],
        channel=section["channel"],
        ignore_config=True,
        **section["options"],
    )
    notifier = can.Notifier(bus, [frames.append], loop=asyncio.get_running_loop())
    try:
        await until(lambda: len(frames) > 3)
        broken.now = True
        await until(lambda: bool(complaints))
        frames.clear()
        await asyncio.sleep(0.2)
        assert not frames
        assert notifier.exception is None  # nobody is told
        assert not notifier.stopped
    finally:
        notifier.stop()
        bus.shutdown()


# An interface without a file descriptor: received by a thread


async def test_an_interface_that_has_no_file_descriptor() -> None:
    section = {
        "interface": "virtual",
        "channel": f"abbe-{time.monotonic_ns()}",
        "dbc": str(DBC),
        "channels": {"T_left": {"message": "TEMPERATURES"}},
        "messages": {"TEMPERATURES": {"within": 0.5}},
    } | QUICK
    link = DbcLink("bench", DbcConfig.model_validate(section))
    with can.Bus(interface="virtual", channel=section["channel"], ignore_config=True) as other:

        async def send() -> None:
            for value in range(10_000):
                data = (value & 0x7FFF).to_bytes(2, "big") + bytes(4)
                other.send(can.Message(arbitration_id=0x202, data=data, is_extended_id=False))
                await asyncio.sleep(0.01)

        sending = asyncio.create_task(send())
        await link.open()
        try:
            assert link.status.state is LinkState.UP, link.status.detail
            first = (await link.read(("T_left",)))["T_left"]
            await asyncio.sleep(0.1)
            assert (await link.read(("T_left",)))["T_left"].value > first.value
            sending.cancel()
            await until(lambda: link.status.state is LinkState.DOWN)
        finally:
            sending.cancel()
            await link.close()
