"""The last readings of a run that ends: recorded in its own process, in a bounded time."""

from __future__ import annotations

import asyncio
import contextlib
import threading

from abbe.daemon.checks.job import CheckOutcome, CheckRequest, record


async def record_in_time(request: CheckRequest, seconds: float) -> CheckOutcome | None:
    """Record readings, when the correction has ended; None where it took too long.

    A thread of its own, which nobody waits for when a disk hangs.
    """
    loop, done = asyncio.get_running_loop(), asyncio.Event()
    outcomes: list[CheckOutcome] = []

    def work() -> None:
        try:
            outcomes.append(record(request))
        except Exception as error:  # noqa: BLE001  (said with what is not recorded)
            why = str(error) or type(error).__name__
            refused = dict.fromkeys((new.typed.name for new in request.readings), why)
            outcomes.append(CheckOutcome(refused=refused))
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody waits any more
            loop.call_soon_threadsafe(done.set)

    threading.Thread(target=work, daemon=True, name="last checks").start()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await done.wait()
    return outcomes[0] if outcomes else None
