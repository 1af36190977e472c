"""Tapes to and from a simulated control in its own process: pace, checks, breaks, alarms."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from abbe.drivers.link import LinkDownError, LinkError, LinkProtocolError, LinkTimeoutError
from abbe.drivers.serial.transfer import (
    TapeMismatchError,
    TapeReport,
    TapeSettings,
    receive_tape,
    send_tape,
)
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.opening import until
from tests.support.drivers.serial.links import ROOM

pytestmark = pytest.mark.integration

BLOCKS = [f"N{10000 + n}P{(n * 7) % 15 - 7}" for n in range(40)]


@contextmanager
def control(*more: str) -> Iterator[SimulatedProcess]:
    with SimulatedProcess("serial", "tape", *more) as process:
        yield process


def settings(process: SimulatedProcess, **more: Any) -> TapeSettings:
    section = {
        "port": process.ready["device"],
        "baudrate": 38400,
        "start_timeout": 10.0,
        "stall_timeout": 10.0,
    }
    return TapeSettings.model_validate(section | more)


async def sent(
    process: SimulatedProcess, *, then: Callable[[], Any] = lambda: None, **more: Any
) -> TapeReport:
    """Send the table to a control whose operator presses READ when the port is open."""
    task = asyncio.create_task(send_tape(settings(process, **more), BLOCKS))
    await asyncio.sleep(0.05)
    await asyncio.to_thread(process.order, "read")
    await asyncio.sleep(0.05)
    then()
    return await task


async def ended(process: SimulatedProcess) -> dict[str, Any]:
    """The control's report once it has taken everything from its buffer."""
    await until(lambda: process.order("report")["complete"])
    return process.order("report")


async def mended(process: SimulatedProcess, after: int) -> None:
    """Plug the control in again once the port broke after so many blocks; press READ."""
    await until(lambda: len(process.order("report")["stored"]) >= after)
    process.order("plug")
    await asyncio.sleep(0.3)
    process.order("read")


@pytest.mark.parametrize("verify", ["none", "echo", "checksum"])
async def test_a_slow_receiver_with_a_small_buffer_loses_nothing(verify: str) -> None:
    # it takes half of what the line carries: DC3 and DC1 all the time
    with control("--verify", verify, "--rate", "1900", "--buffer", "32") as process:
        report = await sent(process, verify=verify)
        taken = await ended(process)
    assert taken["stored"] == BLOCKS
    assert taken["complete"]
    assert taken["lost"] == 0
    assert taken["most_after_stop"] <= 8
    assert (report.blocks, report.tapes, report.verified) == (len(BLOCKS), 1, verify)
    characters = sum(len(block) + 1 for block in BLOCKS) + 4
    assert report.seconds > 0.8 * characters / 1900


async def test_the_line_s_own_speed_is_kept() -> None:
    """A receiver that never stops us gets no more than the line can carry."""
    with control("--rate", "1e6", "--buffer", "4096") as process:
        report = await sent(process, baudrate=9600)
        taken = await ended(process)
    assert taken["stored"] == BLOCKS
    characters = sum(len(block) + 1 for block in BLOCKS) + 4
    assert report.seconds >= (characters - 8) * 10 / 9600


async def test_nothing_is_sent_before_dc1() -> None:
    with control() as process:
        with pytest.raises(LinkTimeoutError, match="did not ask for anything"):
            await send_tape(settings(process, start_timeout=0.3), BLOCKS)
        assert process.order("report")["tapes"] == 0
        assert process.order("report")["most_after_stop"] == 0


async def test_an_echo_that_differs_stops_the_transfer() -> None:
    with control("--verify", "echo") as process:
        process.order("fault", corrupt=17)
        with pytest.raises(TapeMismatchError, match=r"block 17: sent 'N10017P.*stored 'N18017P"):
            await sent(process, verify="echo")
        taken = process.order("report")
    assert len(taken["stored"]) == 18


async def test_a_checksum_that_differs_is_reported() -> None:
    with (
        control("--verify", "checksum") as process,
        pytest.raises(TapeMismatchError, match="receiver's checksum is"),
    ):
        # the receiver's is Modbus's
        await sent(process, verify="checksum", checksum="crc16-xmodem")


async def test_a_break_with_echo_goes_on_where_it_was() -> None:
    with control("--verify", "echo") as process:
        process.order("fault", break_after=15)

        confirmed: list[int] = []
        helper = asyncio.create_task(mended(process, 15))
        task = asyncio.create_task(
            send_tape(settings(process, verify="echo"), BLOCKS, on_confirmed=confirmed.append)
        )
        await asyncio.sleep(0.05)
        await asyncio.to_thread(process.order, "read")
        report = await task
        await helper
        taken = await ended(process)
    assert report.tapes == 2
    assert taken["tapes"] == 2
    assert confirmed == sorted(set(confirmed))
    assert confirmed[-1] == len(BLOCKS)
    # The block whose echo was lost in the break is sent once more; no other.
    assert list(dict.fromkeys(taken["stored"])) == BLOCKS
    assert len(taken["stored"]) <= len(BLOCKS) + 1


async def test_a_break_without_echo_begins_again() -> None:
    with control("--verify", "checksum") as process:
        process.order("fault", break_after=10)
        confirmed: list[int] = []

        helper = asyncio.create_task(mended(process, 10))
        task = asyncio.create_task(
            send_tape(settings(process, verify="checksum"), BLOCKS, on_confirmed=confirmed.append)
        )
        await asyncio.sleep(0.05)
        await asyncio.to_thread(process.order, "read")
        assert (await task).tapes == 2
        await helper
        taken = await ended(process)
    assert confirmed == [len(BLOCKS)]
    assert taken["stored"][-len(BLOCKS) :] == BLOCKS


async def test_a_port_that_does_not_come_back_says_how_far_it_was() -> None:
    with control("--verify", "echo") as process:
        process.order("fault", break_after=5)
        with pytest.raises(LinkDownError, match=r"(4|5) of 40 blocks are confirmed"):
            await sent(process, verify="echo", resume_within=0.3)
        with pytest.raises(LinkDownError, match="no such device"):
            await sent(process, verify="echo", resume_within=0.0)


async def test_an_interrupted_transfer_is_taken_up_by_a_later_one() -> None:
    with control("--verify", "echo") as process:
        task = asyncio.create_task(send_tape(settings(process, verify="echo"), BLOCKS, first=30))
        await asyncio.sleep(0.05)
        await asyncio.to_thread(process.order, "read")
        await task
        assert process.order("report")["stored"] == BLOCKS[30:]


async def test_a_receiver_that_stops_for_good() -> None:
    with control() as process:
        process.order("fault", stalled=True)
        began = time.monotonic()
        with pytest.raises(LinkTimeoutError, match=r"stopped us \(DC3\)"):
            await sent(process, stall_timeout=0.3)
        assert time.monotonic() - began < 3.0 + ROOM


async def test_an_alarm_in_the_middle_stops_the_transfer() -> None:
    with control("--rate", "500") as process:

        def alarm() -> None:
            process.order("alarm", text="P/S 086 DR OFF")

        with pytest.raises((LinkProtocolError, LinkTimeoutError), match="P/S 086"):
            await sent(process, then=alarm, stall_timeout=0.5)


async def test_what_cannot_be_on_a_tape_is_refused_before_anything_is_sent() -> None:
    with control() as process:
        for blocks, wrong in (
            (["N1", "50%"], "block 1 has '%'"),
            (["N1\n"], "block 0 has '\\\\n'"),
            (["µm"], "block 0 has 'µ'"),
            (["N1", " "], "block 1 is empty"),
        ):
            with pytest.raises(LinkError, match=wrong):
                await send_tape(settings(process), blocks)
        assert process.order("report")["tapes"] == 0


async def test_a_tape_comes_back_as_it_was() -> None:
    with control("--verify", "echo", "--baudrate", "38400") as process:
        await sent(process, verify="echo")
        task = asyncio.create_task(receive_tape(settings(process)))
        await asyncio.sleep(0.05)
        await asyncio.to_thread(process.order, "punch")
        assert await task == BLOCKS
        with pytest.raises(LinkTimeoutError, match="the beginning of a tape did not come"):
            await receive_tape(settings(process, start_timeout=0.2))


@pytest.mark.parametrize(
    ("section", "wrong"),
    [
        ({"flow": "xonxoff"}, "swallow DC1 and DC3"),
        ({"verify": "checksum", "checksum_reply": "SUM=(.*)"}, "no field"),
        ({"verify": "checksum", "checksum_reply": "("}, "no regular expression"),
        ({"port": "gopher://x"}, "gopher:// is not known"),
        ({"run_on": 0}, "run_on"),
    ],
)
def test_settings_that_cannot_work(section: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        TapeSettings.model_validate({"port": "/dev/ttyS0"} | section)
