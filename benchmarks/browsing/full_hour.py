"""Pictures of an hour that is full: what they leave in the memory of the server."""

from __future__ import annotations

import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlencode

from benchmarks.browsing.fifty import CHANNELS, EVERY, HOUR, filled, with_more
from benchmarks.browsing.taken import resident
from tests.support.daemon.live_run import compensating, live_run, machine
from tests.support.daemon.workbench import OpenedWorkbench, opened

_VIEWERS = 2
_MOMENTS = 5


def full_hour(turns: int) -> str:
    """Measure; the figures as a page has them."""
    with tempfile.TemporaryDirectory() as name, machine(Path(name)) as (_, config):
        with_more(config)
        with live_run(config) as run:
            run.until(compensating)
            time.sleep(2.0)
        series = filled(Path(name) / "records.sqlite")
        with opened(config) as bench, live_run(config) as run:
            run.until(compensating)
            bench.enter()
            pid = bench.process.pid
            memory = [resident(pid)]
            asked = 0
            with ThreadPoolExecutor(5 * _VIEWERS) as pool:
                for _ in range(_MOMENTS):
                    for _ in range(turns // _MOMENTS):
                        asked += _asked(bench, pool)
                    memory.append(resident(pid))
    kept = ", ".join(f"{m:.1f}" for m in memory[1:])
    return f"""### Pictures of a full hour

The machine with {CHANNELS} channels, an hour of {series} series recorded every {EVERY:g} s; each
picture of it asked for as {_VIEWERS} browsers do, all at once, {asked} pictures in all.

| | |
| --- | --- |
| memory of the server before, MB | {memory[0]:.1f} |
| after each fifth of them, MB | {kept} |

Target: under 120 MB, and no growth. Before threads shared what they let go of
(`daemon/workbench/few_arenas.py`) and readers kept as little of the file as its writer, the same
pictures left 94 to 101 MB, up and down with the threads that made them."""


def _asked(bench: OpenedWorkbench, pool: ThreadPoolExecutor) -> int:
    """Ask for every picture of the last hour, all at once; how many they are."""
    waiting = []
    for _ in range(_VIEWERS):
        known, now = bench.json("/api/live/history"), time.time()
        waiting += [
            pool.submit(
                bench.json,
                "/api/live/picture?"
                + urlencode({"name": p["name"], "first": now - HOUR, "last": now}),
            )
            for p in known["pictures"]
        ]
    for one in waiting:
        one.result()
    return len(waiting)
