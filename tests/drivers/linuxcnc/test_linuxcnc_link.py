"""The link to a real LinuxCNC that runs, homed: pins, external offsets, limits."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
import time
from collections.abc import Iterator

import pytest

from abbe.drivers.link import LinkError, LinkState, Quality, TooLateError, WriteNotVerifiedError
from abbe.drivers.linuxcnc.link import LinuxCncLink
from tests.support.drivers.linuxcnc.links import (
    ACTIVE,
    CHANNELS,
    HOMED,
    LIMITED,
    ON,
    PATIENT,
    linked,
    ordered,
    reaches,
    value,
)
from tests.support.drivers.linuxcnc.machine import Machine
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def machine() -> Iterator[Machine]:
    """Switched on and homed."""
    with Machine() as running:
        running.order("on")
        running.order("home")
        yield running


async def test_positions_are_read(machine: Machine) -> None:
    async with linked(**PATIENT) as link:
        assert link.status.state is LinkState.UP, link.status.detail
        await ordered(machine, "mdi", "G21 G90 G1 F6000 X12.5 Y-7.25")
        samples = await link.read(tuple(CHANNELS))
        assert samples["x"].value == pytest.approx(12.5, abs=1e-9)
        assert samples["motor_y"].value == pytest.approx(-7.25, abs=1e-9)
        assert samples["motor_um"].value == pytest.approx(12500.0, abs=1e-6)
        assert int(samples["state"].value) & (ON | HOMED | ACTIVE | LIMITED) == ON | HOMED
        assert samples["nonsense"].quality is Quality.BAD
        assert "not found" in samples["nonsense"].reason
        assert all(s.good for name, s in samples.items() if name != "nonsense")
        assert link.info("offset_x").unit == "mm"
        assert link.info("offset_x").writable
        assert not link.info("x").writable


async def test_an_offset_moves_the_motor(machine: Machine) -> None:
    async with linked(**PATIENT) as link:
        await ordered(machine, "mdi", "G1 X50 Y20")
        await link.write({"offset_x": 0.0123, "offset_y": -0.0042})
        await reaches(link, "motor_x", 50.0123)
        await reaches(link, "motor_y", 19.9958)
        assert await value(link, "offset_x") == pytest.approx(0.0123, abs=1e-5)
        assert int(await value(link, "state")) & ACTIVE
        # absolute, not one on top of the other
        await link.write({"offset_x": 0.0123})
        await link.write({"offset_x": -0.02})
        await reaches(link, "motor_x", 49.98)
        await ordered(machine, "mdi", "G1 X60")
        await reaches(link, "motor_x", 59.98)
        await link.write({"offset_x": 0.0, "offset_y": 0.0})
        await reaches(link, "motor_x", 60.0)


async def test_many_writes_in_a_row_end_where_the_last_one_says(machine: Machine) -> None:
    async with linked(**PATIENT) as link:
        await ordered(machine, "mdi", "G1 X0 Y0")
        for i in range(100):
            # a servo thread that is stalled takes one up too late: the last one counts
            with contextlib.suppress(WriteNotVerifiedError):
                await link.write({"offset_x": 0.001 * (i % 7), "offset_y": -0.0005 * (i % 5)})
        with contextlib.suppress(WriteNotVerifiedError):
            await link.write({"offset_x": 0.0333, "offset_y": 0.0444})
        await reaches(link, "motor_x", 0.0333)
        await reaches(link, "motor_y", 0.0444)


async def taken(link: LinuxCncLink, offset: float) -> bool:
    """Write X's offset, mm; whether LinuxCNC, whose servo thread may be stalled, took it up."""
    try:
        await link.write({"offset_x": offset})
    except WriteNotVerifiedError:
        return False
    return True


async def test_offsets_follow_a_moving_axis(machine: Machine) -> None:
    """Live: the offset is a function of the position while the axis moves."""
    async with linked(**PATIENT) as link:
        await ordered(machine, "mdi", "G1 X0")
        under_way, end = 0, 0.0
        # back and forth until it was followed often enough, however busy the computer is
        while under_way <= 20 or end == 0.0:
            end = 80.0 - end
            move = asyncio.create_task(ordered(machine, "mdi", f"G1 F6000 X{end:g}"))
            while not move.done():
                x = await value(link, "x")
                under_way += 0.0 < x < 80.0 and await taken(link, 1e-3 * x)
            assert await move == []
        await until(lambda: taken(link, 0.08))
        await reaches(link, "motor_x", 80.08)


async def test_what_is_too_large_is_refused_before_anything_is_written(machine: Machine) -> None:
    async with linked(**PATIENT) as link:
        await link.write({"offset_x": 0.0, "offset_y": 0.0})
        with pytest.raises(LinkError, match="nothing written; offset_y: 0.6 is beyond max = 0.5"):
            await link.write({"offset_x": 0.1, "offset_y": 0.6})
        with pytest.raises(LinkError, match="nothing written; offset_x: nan"):
            await link.write({"offset_x": float("nan")})
        with pytest.raises(LinkError, match="nothing written; motor_x is no offset"):
            await link.write({"offset_x": 0.1, "motor_x": 0.0})
        assert abs(await value(link, "offset_x")) < 1e-5


async def test_soft_limits_hold_an_offset_back_and_it_is_said(machine: Machine) -> None:
    async with linked(**PATIENT) as link:
        await link.write({"offset_x": 0.0})
        await ordered(machine, "mdi", "G1 F12000 X299.97")
        await link.write({"offset_x": 0.02})
        await reaches(link, "motor_x", 299.99)

        async def limited() -> bool:
            try:
                await link.write({"offset_x": 0.05})
            except WriteNotVerifiedError as error:
                return "wrote 0.05, a soft limit lets 0.0" in str(error)
            return False

        await until(limited)
        await asyncio.sleep(0.1)
        assert await value(link, "motor_x") <= 300.0 + 1e-6
        assert int(await value(link, "state")) & LIMITED
        await link.write({"offset_x": 0.0})
        await ordered(machine, "mdi", "G1 X0")
        await reaches(link, "motor_x", 0.0)
        assert not int(await value(link, "state")) & LIMITED


async def test_switched_off_and_on_the_offset_begins_at_zero(machine: Machine) -> None:
    async with linked(**PATIENT) as link:
        await link.write({"offset_x": 0.1})
        await reaches(link, "offset_x", 0.1)
        await ordered(machine, "off")
        with pytest.raises(WriteNotVerifiedError, match="the machine is off"):
            await link.write({"offset_x": 0.2})
        assert not int(await value(link, "state")) & ON
        await ordered(machine, "on")
        # LinuxCNC has set it to zero; what is written next is right all the same
        await reaches(link, "offset_x", 0.0)
        position = await value(link, "motor_x")
        await link.write({"offset_x": 0.05})
        await reaches(link, "offset_x", 0.05)
        await reaches(link, "motor_x", position + 0.05)
        await link.write({"offset_x": 0.0})
        await reaches(link, "offset_x", 0.0)


async def test_without_new_values_the_offset_is_taken_back(machine: Machine) -> None:
    async with linked(**PATIENT | {"lease": 0.3}) as link:

        async def seen() -> bool:
            # a busy computer may look later than it is taken back
            await link.write({"offset_x": 0.1})
            return abs(await value(link, "offset_x") - 0.1) <= 1e-5

        for _ in range(2):
            await until(seen)
            await reaches(link, "offset_x", 0.0)


async def test_a_servo_thread_that_pauses_adds_up_no_offsets(machine: Machine) -> None:
    """What is written meanwhile is asked for once, however often; then it is taken back as ever."""
    pause = PATIENT | {"lease": 0.4, "servo_silence": 30.0, "timeout": 30.0}
    async with linked(**pause) as link:

        async def seen() -> bool:
            await link.write({"offset_x": 0.1})
            return abs(await value(link, "offset_x") - 0.1) <= 1e-5

        await until(seen)
        machine.tell_real_time(signal.SIGSTOP)
        try:
            for _ in range(8):
                with contextlib.suppress(WriteNotVerifiedError):
                    await link.write({"offset_x": 0.2})
                await asyncio.sleep(0.03)
            asked = await value(link, "offset_x")
            # nobody answers for it any more, and it cannot be taken back yet
            await asyncio.sleep(1.5)
        finally:
            machine.tell_real_time(signal.SIGCONT)
        assert asked == pytest.approx(0.1, abs=1e-5)
        most: list[float] = []

        async def gone() -> bool:
            most.append(abs(await value(link, "offset_x")))
            return most[-1] < 1e-5

        await until(gone)
        await asyncio.sleep(0.5)
        assert abs(await value(link, "offset_x")) < 1e-5
        assert max(most) <= 0.2 + 1e-5


async def test_an_offset_that_is_left_out_is_taken_back_by_itself(machine: Machine) -> None:
    """Another axis that is still written does not answer for it."""
    async with linked(lease=0.5) as link:
        await link.write({"offset_x": 0.1, "offset_y": 0.1})
        await reaches(link, "offset_y", 0.1)

        async def gone() -> bool:
            await link.write({"offset_x": 0.1})
            return abs(await value(link, "offset_y")) < 1e-5

        await until(gone)
        assert await value(link, "offset_x") == pytest.approx(0.1, abs=1e-5)
        await link.write({"offset_x": 0.0})


async def test_closing_takes_the_offset_back(machine: Machine) -> None:
    async with linked(**PATIENT) as link:
        await link.write({"offset_x": 0.1})
        await reaches(link, "offset_x", 0.1)
    async with linked(**PATIENT) as link:
        assert abs(await value(link, "offset_x")) < 1e-5


async def test_values_are_no_younger_than_the_servo_thread(machine: Machine) -> None:
    async with linked(servo_silence=30.0, timeout=30.0) as link:
        samples = await link.read(("x", "y", "state"))
        # read within some milliseconds, and by one look
        assert len({sample.time for sample in samples.values()}) == 1
        await until(lambda: fresh(link))
        machine.tell_real_time(signal.SIGSTOP)
        try:
            await asyncio.sleep(0.6)
            # the pins can be read as ever, and nobody brings them up to date
            sample = (await link.read(("x",)))["x"]
            assert sample.good
            assert sample.age() >= 0.5
        finally:
            machine.tell_real_time(signal.SIGCONT)
        await until(lambda: fresh(link))


async def fresh(link: LinuxCncLink) -> bool:
    return (await link.read(("x",)))["x"].age() < 0.1


async def test_a_bridge_that_stands_still_brings_old_values_and_sets_none(
    machine: Machine,
) -> None:
    """Stopped before it reads, and before it sets: what it does afterwards was asked for before."""
    async with linked(timeout=10.0) as link:
        await link.write({"offset_x": 0.0})
        assert link._bridge is not None
        process = link._bridge._process
        assert process is not None
        process.send_signal(signal.SIGSTOP)
        late = asyncio.create_task(link.write({"offset_x": 0.2}, until=time.monotonic() + 0.3))
        await asyncio.sleep(0.6)
        process.send_signal(signal.SIGCONT)
        with pytest.raises(TooLateError, match="not written: offset_x: too old") as error:
            await late
        assert error.value.untouched == {"offset_x"}
        assert abs(await value(link, "offset_x")) < 1e-5
        # an order that was given up does not answer the next one
        process.send_signal(signal.SIGSTOP)
        given_up = asyncio.create_task(link.read(("state",)))
        await asyncio.sleep(0.1)
        given_up.cancel()
        again = asyncio.create_task(link.read(("x", "y")))
        await asyncio.sleep(0.1)
        process.send_signal(signal.SIGCONT)
        samples = await again
        assert all(sample.good for sample in samples.values()), samples


async def test_where_channels_sit(machine: Machine) -> None:
    async with linked() as link:
        offset, x = link.places("offset_x"), link.places("x")
        assert not any(a.overlaps(b) for a in offset for b in x)
        assert any(a.overlaps(b) for a in offset for b in link.places("offset_x"))
        info = link.info("offset_x")
        assert (info.low, info.high, info.step, info.read_back) == (-0.5, 0.5, 1e-5, True)
        assert link.owns == ("linuxcnc hal",)
        link.keep_together(("x", "state"), one_sample=True)


async def test_a_killed_bridge_is_started_again(machine: Machine) -> None:
    async with linked() as link:
        bridge = link._bridge
        assert bridge is not None
        assert bridge._process is not None
        bridge._process.terminate()
        await until(lambda: link.status.state is LinkState.DOWN)
        sample = (await link.read(("x",)))["x"]
        assert sample.quality is Quality.UNAVAILABLE
        await until(lambda: link.status.state is LinkState.UP)
        assert (await link.read(("x",)))["x"].good


async def test_a_python_without_linuxcnc_s_modules(machine: Machine) -> None:
    async with linked(python=sys.executable) as link:
        assert link.status.state is LinkState.DOWN
        assert "No module named" in link.status.detail
    async with linked(python="/usr/bin/no-such-python") as link:
        assert "cannot start /usr/bin/no-such-python: No such file" in link.status.detail


CHILD = """
import asyncio, json, sys
from abbe.drivers.linuxcnc.config import LinuxCncConfig
from abbe.drivers.linuxcnc.link import LinuxCncLink

async def main():
    section = {"channels": {"offset_x": {"offset": "X", "max": 0.5}}, "lease": 600.0, "ramp": 0.3}
    link = LinuxCncLink("child", LinuxCncConfig.model_validate(section))
    await link.open()
    await link.write({"offset_x": 0.1})
    print("written", flush=True)
    await asyncio.sleep(600)

asyncio.run(main())
"""


async def test_an_abbe_that_is_killed_leaves_no_offset_behind(machine: Machine) -> None:
    child = await asyncio.create_subprocess_exec(
        sys.executable, "-c", CHILD, stdout=asyncio.subprocess.PIPE
    )
    assert child.stdout is not None
    async with linked(**PATIENT) as link:
        assert await child.stdout.readline() == b"written\n"
        await reaches(link, "offset_x", 0.1)
        child.kill()
        await child.wait()
        await reaches(link, "offset_x", 0.0)
