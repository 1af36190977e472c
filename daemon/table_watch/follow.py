"""Following a machine by its links: tables made when they are due, an upload proposed when idle."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.tables.volume import Volume
from abbe.daemon.answers.tables.make import TableRequest, make
from abbe.daemon.config import Configuration
from abbe.daemon.outputs import check_folder
from abbe.daemon.pipeline.plan import make_plan
from abbe.daemon.pipeline.reading.convert import PositionConverter, SignalConverter
from abbe.daemon.pipeline.reading.poll import Poll
from abbe.daemon.table_watch.follower import Follower
from abbe.drivers.controllers import Controller
from abbe.drivers.link import Link

_EVERY = 1.0
"""s from one look at the machine to the next."""

Tell = Callable[[dict[str, Any]], None]
"""Takes an event: ``{"event": "waiting" | "tables" | "propose", …}``."""


@dataclass(frozen=True)
class TableTarget:
    """The tables to keep up to date, and their folder."""

    controller: Controller
    options: Mapping[str, str]
    volume: Volume
    points: int | None
    folder: Path
    by: str
    force: bool = False


async def follow(
    configuration: Configuration,
    links: Mapping[str, Link],
    follower: Follower,
    target: TableTarget,
    tell: Tell,
    *,
    duration: float | None = None,
    every: float = _EVERY,
) -> None:
    """Watch a machine until cancelled, or for `duration` s.

    Parameters
    ----------
    configuration
        Where positions and signals are.
    links
        Its links, opened and closed by the caller.
    tell
        Is given an event: ``{"event": "waiting" | "tables" | "propose", …}``.
    """
    axes = configuration.model.machine.structure.axes
    plan = make_plan(configuration, axes, links, with_directions=False)
    guard = configuration.file.guard
    wanted: dict[str, tuple[str, ...]] = {}
    for channels in (plan.fast, plan.slow):
        for link, names in channels.items():
            wanted[link] = (*wanted.get(link, ()), *names)
    poll = Poll(links, wanted)
    # one look in `every` s: a number is seen to have changed since the look before
    patient = max(guard.stale_after, 3.0 * every)
    watch = replace(plan.watch, stale_after=patient, within=max(plan.watch.within, 3.0 * every))
    positions = PositionConverter(plan.positions, watch.stale_after, watch)
    signals = SignalConverter(plan.signals, guard.signals_stale_after)
    until = math.inf if duration is None else time.monotonic() + duration
    waiting: list[str] = []
    proposed = True
    while time.monotonic() < until:
        batch = await poll()
        now = time.monotonic()
        where, _ = positions(batch, now)
        idle = follower.stand(now, where)
        readings = {name: r for name, r in signals(batch, now).items() if not r.fault}
        values = {name: r.value for name, r in readings.items()}
        missing = follower.missing(values)
        if missing:
            if missing != waiting:
                tell({"event": "waiting", "signals": missing})
            waiting = missing
        else:
            waiting = []
            state = follower.take(now, values)
            change = follower.change()
            if follower.due():
                done = await asyncio.to_thread(_make, configuration, target, state)
                follower.made()
                proposed = False
                tell(_event(done, change, target))
        if idle and not proposed:
            proposed = True
            tell({"event": "propose", "folder": str(target.folder)})
        await asyncio.sleep(min(every, max(until - time.monotonic(), 0.0)))


def _make(configuration: Configuration, target: TableTarget, state: SlowState) -> Any:
    request = TableRequest(
        configuration.model_path,
        target.controller,
        target.options,
        state,
        target.volume,
        target.points,
        by=target.by,
        note="made by abbe watch-tables",
    )
    done = make(request, configuration.model)
    reads = (configuration.path, configuration.model_path)
    check_folder(target.folder, reads, (), done.made.files, force=target.force)
    done.made.write(target.folder)
    return done


def _event(done: Any, change: float, target: TableTarget) -> dict[str, Any]:
    left = done.remaining[target.controller.name]
    return {
        "event": "tables",
        "folder": str(target.folder),
        "sha256": done.made.checksum,
        "change_um": change * 1e3 if math.isfinite(change) else None,
        "signals": dict(done.request.state.signals),
        "left_um": {"rms": left.rms * 1e3, "max": left.largest * 1e3},
        "uncertainty": done.made.record["uncertainty"],
        "beyond": [str(one) for one in (done.sure.beyond if done.sure else ())],
    }
