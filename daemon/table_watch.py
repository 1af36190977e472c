"""``abbe watch-tables``: tables made anew when the machine has warmed, upload proposed when idle.

The daemon's configuration says where positions and signals are read; nothing is ever written to the
machine. The tables that were made last hold for the signals of that moment; when the model predicts
that the error has changed by more than a stated amount anywhere in the working volume, they are
made anew.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import typer

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.machine.lag import LagState
from abbe.compcore.model.lags import lags_of
from abbe.compcore.model.model import Model
from abbe.compcore.tables.change import predicted_change
from abbe.compcore.tables.volume import Volume
from abbe.daemon.answers.table import TableRequest, make
from abbe.daemon.config import Configuration
from abbe.daemon.outputs import check_folder
from abbe.daemon.ownership.claims import held_by_watch
from abbe.daemon.ownership.lock import hold
from abbe.daemon.pipeline.plan import make_plan
from abbe.daemon.pipeline.reading.convert import PositionConverter, SignalConverter
from abbe.daemon.pipeline.reading.poll import Poll
from abbe.drivers.controllers import Controller, make_controller
from abbe.drivers.link import Link

_OPEN_WITHIN = 5.0
"""s that a link is given to open."""
_EVERY = 1.0
"""s from one look at the machine to the next."""
_STILL = {"mm": 0.01, "rad": 1e-5}
"""Motion below this is none."""

Tell = Callable[[dict[str, Any]], None]


class Follower:
    """Follows the slow state of a machine and says when its tables are out of date. No I/O.

    Parameters
    ----------
    model, volume
        The model, and where its error counts.
    limit
        Change of the predicted error anywhere that asks for new tables, mm.
    idle_after
        s without motion after which the machine counts as idle.
    tool
        Tool offset, mm.

    Attributes
    ----------
    made_at
        State for which the last tables were made; None before the first.
    """

    def __init__(
        self,
        model: Model,
        volume: Volume,
        limit: float,
        idle_after: float,
        tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._model, self._volume = model, volume
        self._limit, self._idle_after = limit, idle_after
        self._state = SlowState(tool=tool)
        self._lags = {key: LagState(key[1]) for key in lags_of(model)}
        self._needed = model.signals_needed()
        self._still_since = math.inf
        self._stood: tuple[float, ...] = ()
        self.made_at: SlowState | None = None

    def missing(self, signals: Mapping[str, float]) -> list[str]:
        """Signals that the model reads and that are not known."""
        return [n for n in self._needed if not math.isfinite(signals.get(n, math.nan))]

    def take(self, now: float, signals: Mapping[str, float]) -> SlowState:
        """Take in the present signals, all finite; `now` in s on a clock that keeps running."""
        values = {name: float(signals[name]) for name in self._needed}
        lags = {key: lag.step(now, values[key[0]]) for key, lag in self._lags.items()}
        self._state = replace(self._state, signals=values, lags=lags)
        return self._state

    def stand(self, now: float, positions: Sequence[float]) -> bool:
        """Take in the present positions (mm; rotary: rad; NaN: not known); True when idle."""
        axes = self._model.machine.structure.axes
        near = len(self._stood) == len(positions) and all(
            abs(a - b) <= _STILL["rad" if self._model.machine.axes[axis].rotary else "mm"]
            for axis, a, b in zip(axes, positions, self._stood, strict=True)
        )
        if not near or not all(map(math.isfinite, positions)):
            self._stood = tuple(positions)
            self._still_since = now if all(map(math.isfinite, positions)) else math.inf
        return now - self._still_since >= self._idle_after

    def change(self) -> float:
        """Largest change of the predicted error since the last tables, mm; infinite before any."""
        if self.made_at is None:
            return math.inf
        return predicted_change(self._model, self._volume, self.made_at, self._state).largest

    def due(self) -> bool:
        """Whether new tables are asked for."""
        return self.change() > self._limit

    def made(self) -> None:
        """The tables were made for the present state."""
        self.made_at = self._state


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
    order = TableRequest(
        configuration.model_path,
        target.controller,
        target.options,
        state,
        target.volume,
        target.points,
        by=target.by,
        note="made by abbe watch-tables",
    )
    done = make(order, configuration.model)
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
        "signals": dict(done.order.state.signals),
        "left_um": {"rms": left.rms * 1e3, "max": left.largest * 1e3},
    }


def words(event: Mapping[str, Any], config: Path) -> str:
    """An event for people."""
    if event["event"] == "waiting":
        return "waiting for " + ", ".join(event["signals"])
    if event["event"] == "propose":
        return f"the machine is idle: abbe upload {config} {event['folder']}"
    at = ", ".join(f"{k} {v:.2f}" for k, v in event["signals"].items())
    why = "first" if event["change_um"] is None else f"changed by {event['change_um']:.1f} µm"
    return (
        f"tables made ({why}) for {at}: up to {event['left_um']['max']:.1f} µm left; "
        f"{event['folder']}"
    )


@dataclass(frozen=True)
class WatchTask:
    """What ``abbe watch-tables`` was told.

    Attributes
    ----------
    controller, options
        The dialect's name, and its options.
    ranges
        Axis → least and greatest position of the working volume, mm (rotary: rad).
    points
        Most points of a table; None: as many as it takes.
    folder
        Where the tables go.
    by
        Who makes them, for the record.
    force
        Whether foreign files in `folder` are overwritten.
    """

    controller: str
    options: Mapping[str, str]
    ranges: Mapping[str, tuple[float, float]]
    points: int | None
    folder: Path
    by: str
    force: bool


def watch(
    configuration: Configuration,
    task: WatchTask,
    limit: float,
    idle: float,
    duration: float | None,
    as_json: bool,
) -> None:
    """Follow a machine until Ctrl-C, or for `duration` s; `limit` in mm, `idle` in s.

    Raises
    ------
    InputError
        For an unknown controller, or options that it does not have.
    """
    model = configuration.model.switched()
    target = TableTarget(
        make_controller(task.controller, model.machine, task.options),
        task.options,
        Volume.of(model.machine, task.ranges),
        task.points,
        task.folder,
        task.by,
        task.force,
    )
    follower = Follower(model, target.volume, limit, idle, configuration.file.tool.offset)

    def tell(event: dict[str, Any]) -> None:
        text = (
            json.dumps(event, ensure_ascii=False) if as_json else words(event, configuration.path)
        )
        typer.echo(text)

    doing = f"watch-tables with {configuration.path.resolve()}"

    async def run() -> None:
        links = configuration.make_links()
        with hold(held_by_watch(links), doing):
            try:
                for link in links.values():
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(_OPEN_WITHIN):
                            await link.open()
                await follow(configuration, links, follower, target, tell, duration=duration)
            finally:
                closed = (link.close() for link in links.values())
                await asyncio.gather(*closed, return_exceptions=True)

    asyncio.run(run())
