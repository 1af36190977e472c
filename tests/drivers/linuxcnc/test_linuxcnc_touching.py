"""The touch probe of a real LinuxCNC: G38.2 against a block that its real-time part knows."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import numpy as np
import pytest

from abbe.drivers.link import LinkError
from abbe.drivers.linuxcnc.config import LinuxCncConfig
from abbe.drivers.linuxcnc.link import LinuxCncLink
from abbe.drivers.linuxcnc.probing import LinuxCncProbe
from abbe.drivers.touch_probe import NotTouchedError, TouchTravel, touch_probe_of
from tests.support.drivers.linuxcnc.links import ordered
from tests.support.drivers.linuxcnc.touching_mill import TIP, TOOL, TouchingMill, says, tip
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

MIDDLE = np.array([40.0, -25.0, -160.0])
SIZE = (60.0, 30.0, 20.0)
TRAVEL = TouchTravel(speed=150.0, touch_speed=2.0, tip=0.5 * TIP, approach=1.0, search=2.0)
LATE = 1.5 * 2.0 * 0.001
"""mm that it goes on in one servo period, and some more."""
SECTION = {
    "timeout": 10.0,
    "servo_silence": 10.0,
    "channels": {
        "x": {"pin": "joint.0.pos-cmd"},
        "c": {"pin": "axis.c.pos-cmd", "scale": 0.0174532925},
    },
}


@pytest.fixture(scope="module")
def mill() -> Iterator[TouchingMill]:
    with TouchingMill() as running:
        running.lay(MIDDLE, 0.0, SIZE)
        yield running


@asynccontextmanager
async def probing() -> AsyncIterator[LinuxCncProbe]:
    link = LinuxCncLink("mill", LinuxCncConfig.model_validate(SECTION))
    probe = touch_probe_of(link)
    assert isinstance(probe, LinuxCncProbe)
    try:
        await probe.begin(TRAVEL)
        yield probe
    finally:
        await link.close()


def over(*aside: float) -> tuple[float, float, float]:
    """A place so far from the block's middle."""
    x, y, z = (MIDDLE + aside).tolist()
    return x, y, z


TOP = over(0.0, 0.0, 0.5 * SIZE[2])
UP = (0.0, 0.0, 1.0)


async def test_touches_are_where_tip_and_block_really_meet(mill: TouchingMill) -> None:
    """On all sides that can be reached, also with work offsets and a turned coordinate system."""
    await ordered(mill, "mdi", "G10 L2 P1 X7 Y-3 Z11 R25 G92.1")
    await ordered(mill, "mdi", "G20 G91 G92 X1")
    async with probing() as probe:
        await probe.go(over(0.0, 0.0, 40.0))
        for outward in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
            way = np.array(outward)
            beside = over(*(way * (0.5 * np.array(SIZE) + 20.0)))
            await probe.go((beside[0], beside[1], over(0.0, 0.0, 40.0)[2]))
            await probe.go(beside)
            surface = over(*(way * 0.5 * np.array(SIZE)))
            found = await probe.touch(surface, outward)
            place = np.array(surface) + 0.5 * TIP * way
            late = float((says(place[None, :])[0] - found) @ way)
            assert 0.0 <= late <= LATE
            aside = (says(place[None, :])[0] - found) - late * way
            # it was sent to where the controller has the place, and is beside by its own errors
            assert np.abs(aside).max() < 0.06
            at = np.array(await probe.where())
            away = TRAVEL.approach + 2.0 * TRAVEL.tip
            assert np.allclose(at, np.array(surface) + away * way, atol=1e-4)
            await probe.go(beside)
            await probe.go((beside[0], beside[1], over(0.0, 0.0, 40.0)[2]))
        before = np.array(await probe.where())
        # the operator's own settings are again as they were: inch, relative
        await ordered(mill, "mdi", "G0 Z0.1")
        assert np.allclose(await probe.where() - before, (0.0, 0.0, 2.54), atol=1e-4)
    errors = await ordered(mill, "mdi", "G21 G90 G92.1 G10 L2 P1 X0 Y0 Z0 R0")
    assert errors == []


async def test_nothing_there_is_said_and_it_goes_on(mill: TouchingMill) -> None:
    async with probing() as probe:
        await probe.go(over(0.0, 0.0, 40.0))
        high = over(0.0, 0.0, 0.5 * SIZE[2] + 15.0)
        with pytest.raises(NotTouchedError, match="touched nothing"):
            await probe.touch(high, UP)
        at = await probe.where()
        assert at[2] == pytest.approx(high[2] + TRAVEL.tip - TRAVEL.search, abs=1e-3)
        await probe.clear()
        await probe.go(over(0.0, 0.0, 40.0))
        found = await probe.touch(TOP, UP)
        # what tripped last time is not taken for this time's
        with pytest.raises(NotTouchedError):
            await probe.touch(high, UP)
        await probe.go(over(0.0, 0.0, 40.0))
        assert await probe.touch(TOP, UP) == pytest.approx(found, abs=LATE)


async def test_what_is_not_safe_is_not_begun(mill: TouchingMill) -> None:
    async with probing() as probe:
        start = over(0.0, 0.0, 40.0)
        await probe.go(start)
        with pytest.raises(LinkError, match=r"X 301.* is beyond LinuxCNC's soft limits -300 … 300"):
            await probe.go((301.0, start[1], start[2]))
        await ordered(mill, "mdi", "M3 S100")
        with pytest.raises(LinkError, match="the spindle turns"):
            await probe.go(over(0.0, 0.0, 41.0))
        await ordered(mill, "mdi", "M5")
        await probe.begin(TRAVEL)
        mill.hal("in-height.max", 100.0)
        # a servo period later it shows in the pin
        await until(lambda: _in_contact(mill))
        with pytest.raises(LinkError, match="touches something already"):
            await probe.touch(TOP, UP)
        mill.lay(MIDDLE, 0.0, SIZE)
        await ordered(mill, "mdi", "G43.1 Z50")
        with pytest.raises(LinkError, match="another tool offset acts"):
            await probe.go(start)
        mill.take_stylus()
        await probe.begin(TRAVEL)
        await ordered(mill, "off")
        with pytest.raises(LinkError, match="the machine is off"):
            await probe.go(start)
        await ordered(mill, "on")
        await probe.begin(TRAVEL)
        assert await probe.where() == pytest.approx(start, abs=1e-4)
        assert not probe.turns("x")
        with pytest.raises(LinkError, match="LinuxCNC has no axis C"):
            await probe.turn({"c": 0.1})
        with pytest.raises(LinkError, match="no rotary axis"):
            await probe.turn({"x": 0.1})


async def test_a_collision_on_the_way_stops_it(mill: TouchingMill) -> None:
    async with probing() as probe:
        await probe.go(over(60.0, 0.0, 0.0))
        with pytest.raises(LinkError, match="stopped .* before its end: the probe touched someth"):
            await probe.go(over(-60.0, 0.0, 0.0))
        assert (await probe.where())[0] > MIDDLE[0]
    await ordered(mill, "mdi", "G53 G1 F6000 X150")


async def test_an_abort_between_two_moves_ends_it_too(mill: TouchingMill) -> None:
    async with probing() as probe:
        await probe.go(over(0.0, 0.0, 60.0))
        await ordered(mill, "abort")
        with pytest.raises(LinkError, match="somebody else has told LinuxCNC something"):
            await probe.go(over(0.0, 0.0, 50.0))
        await probe.begin(TRAVEL)  # a person says that it may go on
        await probe.go(over(0.0, 0.0, 50.0))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("what", ["abort", "off", "halt", "end", "kill"])
async def test_whoever_stops_it_a_touch_is_none(mill: TouchingMill, what: str) -> None:
    """Operator's abort, machine off, Ctrl-C, Abbe's end, a killed bridge: it stands."""
    await ordered(mill, "mdi", "G53 G1 F9000 X100 Z0")
    far = 12.0
    slow = TouchTravel(speed=150.0, touch_speed=1.0, tip=0.5 * TIP, approach=far, search=2.0)
    async with probing() as probe:
        await probe.begin(slow)
        await probe.go(over(0.0, 0.0, 60.0))
        touch = asyncio.create_task(probe.touch(TOP, UP))
        begins = MIDDLE[2] + 0.5 * SIZE[2] + 0.5 * TIP + far
        await until(lambda: _below(probe, begins - 1.0))
        if what in ("abort", "off"):
            await ordered(mill, what)
            with pytest.raises(LinkError, match="stopped|switched off|somebody else"):
                await touch
        elif what == "halt":
            touch.cancel()
            await probe.halt()
        elif what == "end":
            touch.cancel()
        else:
            process = probe._bridge._process
            assert process is not None
            os.kill(process.pid, signal.SIGKILL)
            with pytest.raises(LinkError, match="ended"):
                await touch
            with pytest.raises(LinkError, match="ended"):
                await probe.go(over(0.0, 0.0, 60.0))
    async with probing() as probe:
        if what == "kill":  # nobody is left to stop it: it comes to the surface, and stops there
            await until(lambda: _below(probe, begins - far + 0.1))
            await asyncio.sleep(0.3)
        await ordered(mill, "on")
        first = await probe.where()
        await asyncio.sleep(0.3)
        assert await probe.where() == first
        assert first[2] > TOP[2] + 0.5 * TIP - 0.1
    await ordered(mill, "mdi", "G21 G90 G53 G1 F9000 Z0")


async def _in_contact(mill: TouchingMill) -> bool:
    return mill.halcmd("getp", "motion.probe-input").strip() == "TRUE"


async def _below(probe: LinuxCncProbe, height: float) -> bool:
    return (await probe.where())[2] < height


async def test_a_feed_that_is_held_is_not_waited_for_forever(
    mill: TouchingMill, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("abbe.drivers.linuxcnc.probing._STANDS", 1.0)
    async with probing() as probe:
        await probe.go(over(0.0, 0.0, 60.0))
        await ordered(mill, "feed", 0.0)
        try:
            with pytest.raises(LinkError, match="is the feed held, or its override at 0"):
                await probe.go(over(0.0, 0.0, 40.0))
            await probe.halt()
        finally:
            await ordered(mill, "feed", 1.0)
        assert (await probe.where())[2] == pytest.approx(over(0.0, 0.0, 60.0)[2], abs=0.1)
        # at a tenth of its feed it goes on
        await probe.begin(TRAVEL)
        move = asyncio.create_task(probe.go(over(0.0, 0.0, 45.0)))
        await until(lambda: _below(probe, over(0.0, 0.0, 59.0)[2]))
        await ordered(mill, "feed", 0.1)
        await move
        await ordered(mill, "feed", 1.0)
        await probe.go(over(0.0, 0.0, 60.0))


async def test_a_probe_that_nobody_connected_moves_nothing(mill: TouchingMill) -> None:
    mill.halcmd("unlinkp", "motion.probe-input")
    try:
        async with probing() as probe:
            with pytest.raises(LinkError, match="nothing is connected to motion.probe-input"):
                await probe.go(over(0.0, 0.0, 50.0))
    finally:
        mill.halcmd("net", "probe", "motion.probe-input")


def test_the_truth_is_what_the_test_takes_it_for(mill: TouchingMill) -> None:
    """Where the real-time net has the tip, beside the formulas of this test."""
    mill.order("mdi", "G21 G90 G53 G1 F12000 Z0")  # takes what the tests before complained of
    for x, y, z in ((10.0, 20.0, -30.0), (-155.0, 80.0, -90.0), (222.0, 150.0, 0.0)):
        assert mill.order("mdi", f"G21 G90 G53 G1 F12000 X{x} Y{y} Z{z}") == []
        found = [float(mill.halcmd("getp", f"from-{a}.out")) for a in "xyz"]
        wanted = tip(np.array([[x, y, z]]))[0] - MIDDLE
        assert found == pytest.approx(wanted.tolist(), abs=3e-5)  # as halcmd prints it
    assert TOOL[:2] == (0.0, 0.0)
