"""The run of ``abbe watch-tables``: links opened, the machine followed, events printed."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from abbe.compcore.model.uncertainty import UNKNOWN
from abbe.compcore.tables.volume import Volume
from abbe.daemon.answers.typed import uploading
from abbe.daemon.config import Configuration
from abbe.daemon.ownership.claims import held_by_watch
from abbe.daemon.ownership.lock import hold
from abbe.daemon.table_watch.follow import TableTarget, follow
from abbe.daemon.table_watch.follower import Follower
from abbe.drivers.controllers import make_controller

_OPEN_WITHIN = 5.0
"""s that a link is given to open."""


def words(event: Mapping[str, Any], config: Path) -> str:
    """An event for people."""
    if event["event"] == "waiting":
        return "waiting for " + ", ".join(event["signals"])
    if event["event"] == "propose":
        return f"the machine is idle: {uploading(config, event['folder'])}"
    at = ", ".join(f"{k} {v:.2f}" for k, v in event["signals"].items())
    why = "first" if event["change_um"] is None else f"changed by {event['change_um']:.1f} µm"
    return "; ".join(
        (
            f"tables made ({why}) for {at}: up to {event['left_um']['max']:.1f} µm left, "
            f"{_sure(event['uncertainty'])}",
            *event["beyond"],
            event["folder"],
        )
    )


def _sure(known: Mapping[str, Any] | None) -> str:
    if known is None:
        return UNKNOWN
    return f"the model ± {known['largest']:.1f} µm at most (k = {known['k']:g})"


@dataclass(frozen=True)
class WatchTask:
    """What ``abbe watch-tables`` is given on the command line.

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
