"""Links that are open while a test runs, and waiting for what they show."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, TypeVar

from abbe.drivers.link import Link

L = TypeVar("L", bound=Link)


@asynccontextmanager
async def opened(link: L) -> AsyncIterator[L]:
    """A link, open, and closed behind the test."""
    await link.open()
    try:
        yield link
    finally:
        await link.close()


async def until(true: Callable[[], Any], limit: float = 60.0) -> float:
    """Wait for something (or what can be awaited) to become true; how long it took, s."""
    began = time.monotonic()
    while True:
        found = true()
        if await found if asyncio.iscoroutine(found) or asyncio.isfuture(found) else found:
            return time.monotonic() - began
        assert time.monotonic() - began < limit, "did not happen"
        await asyncio.sleep(0.005)
