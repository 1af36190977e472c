"""An interface that opens only as the event loop ends: it must not stay locked."""

from __future__ import annotations

import asyncio

import pytest

from abbe.drivers.link import LinkState
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.can.links import READ, all_good, linked

pytestmark = pytest.mark.integration


async def test_what_opens_too_late_is_closed() -> None:
    with SimulatedProcess("can", "--frames", "0.02") as bus:
        slow = {"options": {"sleep_after_open": 1.0}, "open_timeout": 0.1}

        async def in_vain() -> None:
            async with linked(bus.ready, READ, **slow) as link:
                assert link.status.state is not LinkState.UP

        # a loop of its own, which ends while python-can still sleeps
        await asyncio.to_thread(asyncio.run, in_vain())
        async with linked(bus.ready, READ) as link:
            await all_good(link, tuple(READ))
