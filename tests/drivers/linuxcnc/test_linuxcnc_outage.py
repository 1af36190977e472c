"""LinuxCNC that is not there, ends, is killed, is started again, or takes no offsets."""

from __future__ import annotations

import asyncio
import logging

import pytest

from abbe.drivers.link import LinkDownError, LinkState
from tests.support.drivers.linuxcnc.links import linked, ordered, reaches
from tests.support.drivers.linuxcnc.machine import Machine
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration


async def test_an_axis_that_takes_no_offsets() -> None:
    changes = {"OFFSET_AV_RATIO = 0.2\n\n[JOINT_1]": "\n[JOINT_1]"}
    with Machine(changes):
        async with linked() as link:
            assert link.status.state is LinkState.DOWN
            assert "[AXIS_Y] of" in link.status.detail
            assert "has no OFFSET_AV_RATIO" in link.status.detail


async def test_linuxcnc_ended_killed_and_started_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, logger="abbe.drivers")
    async with linked() as link:
        assert link.status.state is LinkState.DOWN
        assert "LinuxCNC is not running" in link.status.detail
        with Machine() as machine:
            await until(lambda: link.status.state is LinkState.UP)
            await asyncio.to_thread(machine.stop)
            await until(lambda: link.status.state is LinkState.DOWN)
            with pytest.raises(LinkDownError, match="not written: offset_x"):
                await link.write({"offset_x": 0.1})
            await asyncio.to_thread(machine.start)
            await until(lambda: link.status.state is LinkState.UP)
            assert (await link.read(("x",)))["x"].good
            await asyncio.to_thread(machine.kill)
            await until(lambda: link.status.state is LinkState.DOWN)
            assert "stands still" in link.status.detail or "not running" in link.status.detail
            await asyncio.to_thread(machine.start)
            await until(lambda: link.status.state is LinkState.UP)
            await ordered(machine, "on")
            await ordered(machine, "home")
            await link.write({"offset_x": 0.01})
            await reaches(link, "motor_x", 0.01)
    said = [r.getMessage() for r in caplog.records if hasattr(r, "event")]
    assert [text.split("(LinuxCNC) ")[1][:4] for text in said] == [
        "lost", "back", "lost", "back", "lost", "back",
    ]  # fmt: skip
