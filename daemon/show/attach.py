"""Running a service in view: as a live screen, as plain lines, or as JSON lines."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any, Literal

from rich.console import Console

from abbe.compcore.errors import AbbeError
from abbe.daemon.event_log import journal
from abbe.daemon.service import Service
from abbe.daemon.show.json_lines import JsonLines
from abbe.daemon.show.plain import PlainLines
from abbe.daemon.show.screen import LiveScreen
from abbe.daemon.show.writer import LineWriter
from abbe.daemon.status.figures import Figures
from abbe.daemon.systemd.journald import leads_to_journal

How = Literal["screen", "plain", "json", "quiet"]


def choose(as_json: bool, *, quiet: bool = False) -> How:
    """JSON where asked for, nothing where that is; the live screen on a terminal, else lines.

    A service manager shows the state by itself, and its journal keeps events: neither is given
    lines.
    """
    if as_json:
        return "json"
    if quiet or "NOTIFY_SOCKET" in os.environ or leads_to_journal(sys.stdout):
        return "quiet"
    return "screen" if sys.stdout.isatty() else "plain"


def run_in_view(
    service_of: Callable[[], Service],
    how: How,
    title: str,
    duration: float | None,
    last: Callable[[Figures], Mapping[str, Any]] | None = None,
) -> Figures:
    """Run a service to its end, shown as `how` says.

    Parameters
    ----------
    service_of
        Makes the service, in the event loop.
    how
        What is shown on standard output.
    title
        First words of the screen.
    duration
        s to run, None: until SIGINT or SIGTERM.
    last
        Makes the last JSON line from the run's figures.

    Returns
    -------
    The run's figures.

    Raises
    ------
    AbbeError
        At the end, when standard output did not take the lines.
    """
    return asyncio.run(_run(service_of, how, title, duration, last))


_SWITCH = 5e-4
"""s after which a thread that draws or writes hands over to the cycle; with Python's 5 ms every
picture would show in the cycle's time."""


async def _run(
    service_of: Callable[[], Service],
    how: How,
    title: str,
    duration: float | None,
    last: Callable[[Figures], Mapping[str, Any]] | None,
) -> Figures:
    sys.setswitchinterval(_SWITCH)
    service = service_of()
    pipeline, machine = service.pipeline, service.configuration.model.machine
    corrected = pipeline.corrected_axes
    figures = service.logbook.figures
    section = service.configuration.file.journal
    writer: LineWriter | None = None
    drawing: asyncio.Task[None] | None = None
    handlers: list[logging.Handler] = []
    if how == "screen":
        screen = LiveScreen(
            machine,
            pipeline.axes,
            corrected,
            service.links,
            title,
            duration,
            service.uncertainty,
            service.checks,
        )
        service.add([screen])
        handlers.append(screen.events)
    elif how != "quiet":
        writer = LineWriter(sys.stdout)
        if how == "json":
            sure = service.uncertainty
            lines = JsonLines(writer, machine, pipeline.axes, corrected, service.links, sure)
            service.add([lines])
        else:
            sure = service.uncertainty
            service.add([PlainLines(writer, service.links, figures.axes, sure)])
    with (
        service.owning(),
        journal(
            service.configuration.journal_path,
            max_bytes=section.max_bytes,
            keep=section.keep,
            to_stderr=how != "screen",
            more=handlers,
        ),
    ):
        if how == "screen":
            drawing = asyncio.create_task(screen.run(Console()))
        try:
            await service.run(duration)
        finally:
            if drawing is not None:
                drawing.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await drawing
            if writer is not None:
                end = () if last is None or how != "json" else (json.dumps(last(figures)),)
                writer.end(*end)
    if writer is not None and writer.failed:
        raise AbbeError(
            f"standard output could not be written: {writer.failed}; the machine was "
            "corrected to the end"
        )
    return figures
