"""Signals of a DBC file over a simulated slcan adapter in its own process."""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import Iterator
from typing import Any

import pytest
from can_links import ASK_Z, CORRECTION, DBC, QUICK, READ, Z, linked, until

from drivers.can.dbc_config import DbcConfig
from drivers.can.dbc_link import DbcLink
from drivers.link import LinkConfigError, LinkDownError, LinkError, LinkState, Quality
from drivers.simulated.process import SimulatedProcess

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can", "--frames", "0.01") as process:
        yield process


@pytest.fixture
def own_bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can", "--frames", "0.01") as process:
        yield process


async def test_signals_are_read(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        samples = await link.read(tuple(READ))
        assert samples["T_left"].value == pytest.approx(21.5)
        assert samples["T_right"].value == pytest.approx(-3.25)
        # latched together: Y is exactly 1000 mm further
        assert samples["position_y"].value - samples["x"].value == pytest.approx(1000.0)
        assert samples["y_um"].value == pytest.approx(1000.0 * samples["position_y"].value)
        assert samples["x"].time == samples["position_y"].time
        assert samples["x"].age() < 1.0
        assert link.info("x").unit == "mm"
        assert link.info("y_um").unit == "um"
        assert link.info("T_left").unit == "degC"
        assert "signal position_x of POSITION (201h)" in link.channels["x"]


async def test_values_move_on(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ) as link:
        seen = set()
        while len(seen) < 5:
            seen.add((await link.read(("x",)))["x"])
            await asyncio.sleep(0.01)


async def test_pages_of_a_multiplexed_message_in_a_frame_with_a_long_id(
    bus: SimulatedProcess,
) -> None:
    channels = {"supply": {"message": "DIAGNOSIS"}, "hours": {"message": "DIAGNOSIS"}}
    async with linked(bus.ready, channels) as link:

        async def both() -> bool:
            samples = await link.read(("supply", "hours"))
            return all(s.good for s in samples.values())

        await until(both)
        samples = await link.read(("supply", "hours"))
        assert [s.value for s in samples.values()] == [pytest.approx(24.1), 12345.0]
        assert samples["supply"].time != samples["hours"].time
        assert "18FF0012h" in link.channels["supply"]


async def test_a_message_that_is_asked_for(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ | Z, messages=ASK_Z) as link:
        before = link.status.requests
        first = (await link.read(("x", "position_z")))["position_z"]
        assert first.good
        await asyncio.sleep(0.02)
        second = (await link.read(("position_z",)))["position_z"]
        assert second.value != first.value
        assert second.time > first.time
        assert link.status.requests - before == 2
        assert 0.0 < link.status.round_trip < 1.0
    frame = {"id": 0x203, "data": ""}
    async with linked(bus.ready, Z, messages={"POSITION_Z": {"request": frame}}) as link:
        # a data frame of that id is not what this device answers
        assert link.status.state is LinkState.DOWN
        assert "no request is answered" in link.status.detail


async def test_messages_are_sent(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ | CORRECTION) as link:
        with pytest.raises(LinkError, match="CORRECTION also has correction_y, correction_z, life"):
            await link.write({"correction_x": 0.1})
        await link.write(
            {"correction_x": 0.1, "correction_y": -0.2, "correction_z": 0.0003, "life": 7}
        )
        await link.write({"life": 8})

        def sent() -> bool:
            return bus.order("report")["setpoints"][-2:] == [
                struct.pack("<hhhBx", 1000, -2000, 3, 7).hex(),
                struct.pack("<hhhBx", 1000, -2000, 3, 8).hex(),
            ]

        await until(sent)
        with pytest.raises(LinkError, match="nothing written; CORRECTION: .*correction_x.*5"):
            await link.write({"correction_x": 5.0})
        with pytest.raises(LinkError, match="nothing written; not writable: x"):
            await link.write({"life": 9, "x": 1.0})
        assert sent()
        assert (await link.read(("life",)))["life"].quality is Quality.BAD


async def test_an_adapter_unplugged_and_plugged_in(
    own_bus: SimulatedProcess, caplog: pytest.LogCaptureFixture
) -> None:
    async with linked(own_bus.ready, READ | CORRECTION) as link:
        own_bus.order("unplug")
        await until(lambda: link.status.state is LinkState.DOWN)
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        with pytest.raises(LinkDownError, match="not written: correction_x"):
            await link.write(dict.fromkeys(CORRECTION, 1.0))
        own_bus.order("plug")
        await until(lambda: link.status.state is LinkState.UP)
        assert (await link.read(("x",)))["x"].good
    said = [r.getMessage() for r in caplog.records if r.name.startswith("abbe")]
    assert ["lost: receiving failed" in said[0], "back after" in said[-1], len(said)] == [
        True, True, 2,
    ]  # fmt: skip


async def test_an_adapter_that_forgot_that_it_was_opened(own_bus: SimulatedProcess) -> None:
    """No error anywhere, just silence: opening it again is what helps."""
    async with linked(own_bus.ready, READ) as link:
        own_bus.order("reset_adapter")
        await until(lambda: link.status.state is LinkState.DOWN)
        assert "nothing comes" in link.status.detail
        await until(lambda: link.status.state is LinkState.UP)
        assert link.status.reconnects == 1
        assert (await link.read(("x",)))["x"].good


async def test_without_our_watch_that_would_last_for_ever(
    own_bus: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(DbcLink, "_look", lambda self: None)
    async with linked(own_bus.ready, READ) as link:
        own_bus.order("reset_adapter")
        await asyncio.sleep(1.0)
        assert link.status.state is LinkState.UP
        assert not (await link.read(("x",)))["x"].good


async def test_cyclic_messages_stop_and_what_is_asked_for_goes_on(
    own_bus: SimulatedProcess,
) -> None:
    async with linked(own_bus.ready, READ | Z, messages=ASK_Z) as link:
        own_bus.order("mute", muted=True)
        await until(lambda: link.status.state is LinkState.DEGRADED)
        assert set(link.status.quarantined) >= {"message POSITION", "message TEMPERATURES"}
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        assert "POSITION did not come for" in sample.reason
        own_bus.order("mute", muted=False)
        await until(lambda: link.status.state is LinkState.UP)


async def test_an_unanswered_request_costs_one_time_out(own_bus: SimulatedProcess) -> None:
    async with linked(own_bus.ready, READ | Z, messages=ASK_Z, timeout=0.2) as link:
        own_bus.order("deaf_adapter", deaf=True)
        began = time.monotonic()
        samples = await link.read(("x", "position_z"))
        assert time.monotonic() - began < 0.2 + 1.0
        assert samples["x"].good
        assert samples["position_z"].quality is Quality.UNAVAILABLE
        assert "no answer in 0.2 s" in samples["position_z"].reason
        # its answer might still come and is not to pass for the next one's
        sample = (await link.read(("position_z",)))["position_z"]
        assert sample.quality is Quality.UNAVAILABLE
        own_bus.order("deaf_adapter", deaf=False)

        async def good() -> bool:
            return (await link.read(("position_z",)))["position_z"].good

        await until(good)


async def test_a_second_link_on_the_same_adapter_is_told_so(bus: SimulatedProcess) -> None:
    async with linked(bus.ready, READ) as first, linked(bus.ready, READ) as second:
        assert second.status.state is LinkState.DOWN
        assert "another program has it" in second.status.detail
        await asyncio.sleep(0.3)
        assert first.status.state is LinkState.UP
        assert first.status.reconnects == 0


async def test_interfaces_and_options_that_do_not_exist(bus: SimulatedProcess) -> None:
    section = {"dbc": str(DBC), "channels": READ, "interface": "telepathy", "channel": 0} | QUICK
    link = DbcLink("bench", DbcConfig.model_validate(section))
    with pytest.raises(LinkConfigError, match=r"interface 'telepathy'.*there are: .*socketcan"):
        await link.open()
    section |= {"interface": "slcan", "channel": "x", "options": {"sleep_after_opne": 1}}
    link = DbcLink("bench", DbcConfig.model_validate(section))
    with pytest.raises(
        LinkConfigError, match="no 'sleep_after_opne'; there are: .*sleep_after_open"
    ):
        await link.open()
    ready = {"interface": "slcan", "channel": "/dev/abbe-no-such-port"}
    async with linked(ready, READ) as down:
        assert "No such file" in down.status.detail


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"dbc": "/no/such.dbc"}, "there is no file /no/such.dbc"),
        ({"channels": {"x": {"message": "NO"}}}, "no message 'NO'; it has: POSITION, TEMP"),
        ({"channels": {"x": {"message": "POSITION"}}}, "no signal 'x'; it has: position_x"),
        ({"messages": {"NO": {}}}, "messages.NO: .* has no message"),
        ({"messages": {"POSITION_Z": {}}}, "messages.POSITION_Z is used by no channel"),
        ({"channels": {"x": {"message": "M", "scale": 0.0}}}, "scale is 0"),
        ({"messages": {"POSITION": {"request": {"id": 1, "data": "0"}}}}, "up to eight bytes"),
        ({"channel": None}, "channel"),
        ({"bit_rate": 5}, "Extra inputs"),
    ],
)
def test_a_configuration_that_cannot_work(change: dict[str, Any], wrong: str) -> None:
    section = {"dbc": str(DBC), "channels": READ, "interface": "slcan", "channel": "x"}
    with pytest.raises(ValueError, match=wrong):
        DbcLink("bench", DbcConfig.model_validate(section | change))


def test_a_file_that_is_no_dbc(tmp_path: Any) -> None:
    file = tmp_path / "bad.dbc"
    file.write_text("BO_ nonsense")
    config = DbcConfig.model_validate(
        {"dbc": "bad.dbc", "channels": READ, "interface": "slcan", "channel": "x"},
        context={"folder": tmp_path},
    )
    with pytest.raises(LinkConfigError, match=r"bad.dbc cannot be read: "):
        DbcLink("bench", config)
