"""The process that records and judges readings, as the run sees it: started, asked, ended."""

from __future__ import annotations

import asyncio
import pickle
import sys

from abbe.daemon.checks.job import CheckOutcome, CheckRequest


async def judged(request: CheckRequest, seconds: float) -> CheckOutcome:
    """Record and judge in a process of its own, which is ended when this is cancelled.

    Raises
    ------
    TimeoutError
        When it takes longer than `seconds`.
    RuntimeError, TypeError
        When it fails, or answers something else.
    """
    # a session of its own: what a terminal sends to all is for the run
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "abbe.daemon.checks.job",
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    try:
        data = await asyncio.to_thread(pickle.dumps, request)
        async with asyncio.timeout(seconds):
            out, said = await process.communicate(data)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode:
        lines = said.decode("utf-8", "replace").strip().splitlines() or ["no reason"]
        raise RuntimeError(f"its process ended with {process.returncode}: {lines[-1]}")
    found = pickle.loads(out)
    if not isinstance(found, CheckOutcome):
        raise TypeError("its process gave another answer")
    return found
