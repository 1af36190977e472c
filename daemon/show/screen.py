"""The live screen: what a metrologist wants to see at a glance, refreshed a few times a second."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections import deque
from collections.abc import Mapping

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from abbe.compcore.machine.machine import Machine
from abbe.daemon.guard import GuardState
from abbe.daemon.pipeline.compensate import direction_index
from abbe.daemon.pipeline.headline import headline
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty, PlusMinus
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.show.bars import deviation_bar, sparkline
from abbe.daemon.status.ages import age_in_words
from abbe.daemon.status.check_status import check_status
from abbe.daemon.status.figures import ErrorFigures, volumetric_errors
from abbe.daemon.status.last_cycles import LastCycles
from abbe.daemon.status.live_checks import AskedChecks, LiveChecksState
from abbe.daemon.status.text import check_lines
from abbe.daemon.status_word import describe
from abbe.drivers.link import Link, LinkState

REFRESH = 0.25
"""s from one picture to the next."""

_HISTORY = 48
"""Columns of the error's history."""
_COLUMN = 0.5
"""s in one column."""
_WIDE, _MIDDLE = 120, 92
"""Columns from which on the bars, and the true position, have room."""
_STYLES = {
    GuardState.ACTIVE: ("in full", "green"),
    GuardState.RISING: ("ramped in", "yellow"),
    GuardState.HOLDING: ("held", "yellow"),
    GuardState.FALLING: ("ramped to zero", "red"),
    GuardState.OFF: ("off", "red"),
}
_LINK_STYLES = {LinkState.UP: "green", LinkState.DEGRADED: "yellow"}


class EventTail(logging.Handler):
    """Keeps the last few log records for the screen.

    Parameters
    ----------
    length
        How many.
    """

    def __init__(self, length: int = 5) -> None:
        super().__init__(logging.INFO)
        self.lines: deque[tuple[int, str]] = deque(maxlen=length)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record's level and text."""
        clock = time.strftime("%H:%M:%S", time.localtime(record.created))
        self.lines.append((record.levelno, f"{clock}  {record.getMessage()}"))


class LiveScreen:
    """A listener that keeps what is to be seen, and a task that draws it.

    Parameters
    ----------
    machine
        For names and units.
    axes, corrected_axes
        Order of a record's positions.
    links
        Shown with their state.
    title
        First words of the screen.
    duration
        s that the run will last, None: until it is ended.
    sure
        Says how sure the correction is.
    checks
        Say whether the machine is the one that its model describes.
    """

    def __init__(
        self,
        machine: Machine,
        axes: tuple[str, ...],
        corrected_axes: tuple[str, ...],
        links: Mapping[str, Link],
        title: str,
        duration: float | None = None,
        sure: LiveUncertainty | None = None,
        checks: AskedChecks | None = None,
    ) -> None:
        self._machine = machine
        self._sure = sure
        self._checks = checks
        self._axes = axes
        self._corrected = corrected_axes
        self._indices = tuple(axes.index(a) for a in corrected_axes if not machine.axes[a].rotary)
        self._links = links
        self._title = title
        self._duration = duration
        self.events = EventTail()
        self._cycles = LastCycles()
        self._first_signals: dict[str, float] = {}
        self._durations: deque[float] = deque(maxlen=1000)
        self._before: deque[float] = deque(maxlen=_HISTORY)
        self._after: deque[float] = deque(maxlen=_HISTORY)
        self._column_ends = 0.0
        self._column = (ErrorFigures(), ErrorFigures())
        self._whole = (ErrorFigures(), ErrorFigures())

    def __call__(self, record: CycleRecord) -> None:
        """Take a cycle in."""
        self._cycles(record)
        self._durations.append(record.duration)
        errors = volumetric_errors(record, self._indices)
        if errors is None:
            return
        for figures, error in zip(self._column, errors, strict=True):
            figures.add(error)
        if record.decision.compensating:
            for figures, error in zip(self._whole, errors, strict=True):
                figures.add(error)
        if record.time >= self._column_ends:
            self._column_ends = record.time + _COLUMN
            self._before.append(self._column[0].rms)
            self._after.append(self._column[1].rms)
            self._column = (ErrorFigures(), ErrorFigures())

    async def run(self, console: Console) -> None:
        """Draw until cancelled, or until the terminal is closed; the last picture stays."""
        with contextlib.suppress(OSError):
            await self._draw(console)

    async def _draw(self, console: Console) -> None:
        with Live(console=console, auto_refresh=False, transient=False) as live:
            try:
                while True:
                    # a terminal that is held (Ctrl-S) blocks the thread, not the cycle
                    picture = self.picture(console.width)
                    await asyncio.to_thread(live.update, picture, refresh=True)
                    await asyncio.sleep(REFRESH)
            finally:
                live.update(self.picture(console.width), refresh=True)

    def picture(self, width: int = 80) -> RenderableType:
        """The screen as it is now, for a terminal of so many columns."""
        record = self._cycles.latest
        if record is None:
            waiting = [f"{n}: {link.status.state.value}" for n, link in self._links.items()]
            return Panel(f"waiting for the first cycle … {', '.join(waiting)}", title=self._title)
        parts: list[RenderableType] = [self._state(record), Text(), self._axes_table(record, width)]
        if self._sure is not None and (latest := self._sure.latest) is not None:
            parts.append(_how_sure(latest))
        if self._checks is not None and self._checks.wanted:
            parts.append(_still_true(self._checks.state))
        if self._before:
            parts += [Text(), self._errors(width)]
        parts += [Text(), self._signals(record, width), Text(), self._health(record)]
        if self.events.lines:
            parts.append(self._events())
        return Panel(Group(*parts), title=self._title, title_align="left", expand=False)

    def _state(self, record: CycleRecord) -> RenderableType:
        words = headline(record).upper()
        good = record.in_full
        off = "NOT CORRECTED" in words and "ENDED" not in words
        style = "bold white on green" if good else "bold white on red" if off else "bold on yellow"
        clock = f"{record.time:.0f} s"
        if self._duration is not None:
            clock += f" of {self._duration:.0f} s"
        line = Text.assemble((f" {words} ", style), "   ", (clock, "dim"))
        if record.shown is not None:
            parts = zip("XYZ", record.shown, strict=True)
            moves = "  ".join(f"{d} {1e3 * c:+.1f}" for d, c in parts)
            line.append(f"\nonly shown, not applied: {moves} µm", "yellow")
        if record.pose is not None and (record.pose.damped or record.pose.limited):
            left = 1e6 * record.pose.direction_left
            line.append(f"\n{left:.1f} µrad of the tool's lean left: near a pole", "yellow")
        for what, why in record.faults.items():
            line.append(f"\n{what}: {why}", "red")
        return line

    def _axes_table(self, record: CycleRecord, width: int) -> Table:
        reference = any(map(math.isfinite, record.reference))
        bars, true_position = width >= _WIDE, reference and width >= _MIDDLE
        gap = 2 if bars else 1
        table = Table(box=None, pad_edge=False, header_style="dim", padding=(0, gap, 0, 0))
        for heading in ("axis", "indicated mm", "corrected mm", "correction µm"):
            table.add_column(heading, justify="right", no_wrap=True)
        if bars:
            table.add_column("")
        table.add_column("guard", no_wrap=True)
        if true_position:
            table.add_column("true position mm", justify="right", no_wrap=True)
        if reference:
            for heading in ("error µm before", "after") if bars else ("before µm", "after µm"):
                table.add_column(heading, justify="right", no_wrap=True)
        corrected = dict(zip(self._corrected, record.corrected, strict=True))
        full = max(10.0, *(1e3 * abs(c) for c in record.decision.correction[:3]))
        for axis, indicated, true in sorted(
            zip(self._axes, record.indicated, record.reference, strict=True)
        ):
            rotary = self._machine.axes[axis].rotary
            row: list[str | Text] = [Text(axis, "bold"), self._indicated(axis, indicated, rotary)]
            if axis in corrected:
                direction = direction_index(axis, record.directions)
                amount = record.decision.correction[direction]
                words, style = _STYLES[record.decision.states[direction]]
                row.append(Text(_position(corrected[axis], rotary), "bold"))
                row.append(f"{1e6 * amount:+.1f} µrad" if rotary else f"{1e3 * amount:+.1f}")
                bar = "" if rotary else deviation_bar(1e3 * amount, full)
                row += [Text(bar, "cyan")] if bars else []
                row.append(Text(words, style))
            else:
                row += [""] * (4 if bars else 3)
            if true_position:
                row.append(_position(true, rotary))
            if reference and rotary:
                row += ["", ""]
            elif reference:
                row += [
                    _micrometres(true - indicated, "red"),
                    _micrometres(true - corrected.get(axis, math.nan), "green"),
                ]
            table.add_row(*row)
        return table

    def _indicated(self, axis: str, indicated: float, rotary: bool) -> str | Text:
        """A position; the last sound one with its age where there is none now."""
        now, sound = self._cycles.latest, self._cycles.sound
        if math.isfinite(indicated) or now is None or sound is None:
            return _position(indicated, rotary)
        old = age_in_words(now.time - sound.time + sound.age)
        last = _position(sound.indicated[self._axes.index(axis)], rotary)
        return Text(f"stale, {old}  {last}", "red")

    def _errors(self, width: int) -> Table:
        columns = min(_HISTORY, width - 44)
        before, after = list(self._before)[-columns:], list(self._after)[-columns:]
        top = max((v for v in before if math.isfinite(v)), default=1.0)
        table = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
        table.add_column("error µm", no_wrap=True)
        seconds = int(columns * _COLUMN)
        table.add_column(f"last {seconds} s, full height {top:.0f}", width=columns, no_wrap=True)
        for heading in ("now", "rms", "largest"):
            table.add_column(heading, justify="right", no_wrap=True)
        rows = (("before", before, "red"), ("after", after, "green"))
        for (name, history, style), whole in zip(rows, self._whole, strict=True):
            table.add_row(
                Text(name, style),
                Text(sparkline(history, top), style),
                f"{history[-1]:.1f}",
                Text(f"{whole.rms:.2f}" if whole.count else "", style),
                f"{whole.max:.1f}" if whole.count else "",
            )
        whole_before, whole_after = self._whole
        if whole_after.count and whole_after.rms > 0.0:
            times = f"{whole_before.rms / whole_after.rms:.0f} times smaller"
            table.add_row("", Text(times, "bold green", justify="right"))
        return table

    def _signals(self, record: CycleRecord, width: int) -> RenderableType:
        grid = Table.grid(padding=(0, 3, 0, 0))
        cells: list[Text] = []
        for name, reading in record.signals.items():
            unit = self._machine.signals[name].unit
            unit = {"degC": "°C"}.get(unit, unit)
            if not math.isfinite(reading.value):
                cells.append(Text(f"{name} –", "red"))
                continue
            first = self._first_signals.setdefault(name, reading.value)
            text = Text(f"{name} {reading.value:.2f} {unit} ", "red" if reading.fault else "")
            if reading.fault:
                text.append(f"stale, {age_in_words(time.monotonic() - reading.time)}", "red")
            else:
                text.append(f"{reading.value - first:+.2f}", "dim")
            cells.append(text)
        per_row = max(1, (width - 4) // 25)
        for start in range(0, len(cells), per_row):
            grid.add_row(*cells[start : start + per_row])
        return Group(Text("sensors, and their change since the start", "dim"), grid)

    def _health(self, record: CycleRecord) -> Text:
        text = Text()
        for name, link in self._links.items():
            status = link.status
            style = _LINK_STYLES.get(status.state, "red")
            text.append(f"link {name} ")
            text.append(status.state.value, style)
            if math.isfinite(status.round_trip):
                text.append(f", {1e3 * status.round_trip:.1f} ms", "dim")
            if status.reconnects:
                text.append(f", {status.reconnects} reconnects", "yellow")
            text.append("   ")
        ordered = sorted(self._durations)
        middle, high = ordered[len(ordered) // 2], ordered[int(0.99 * len(ordered))]
        text.append(f"cycle {1e3 * middle:.1f} ms (99 %: {1e3 * high:.1f} ms)   ")
        text.append(f"\nstatus word {record.status:#06x}: {describe(record.status)}", "dim")
        return text

    def _events(self) -> Text:
        text = Text()
        for level, line in self.events.lines:
            text.append("\n" + line, "yellow" if level >= logging.WARNING else "dim")
        return text


def _how_sure(latest: PlusMinus) -> Text:
    """± of the correction, and what lies outside of what was measured."""
    wide = "  ".join(f"{d} ± {1e3 * w:.1f}" for d, w in zip("XYZ", latest.wide, strict=True))
    text = Text.assemble(("how sure (k = 2)  ", "dim"), f"{wide} µm")
    for beyond in latest.beyond:
        text.append(f"\n{beyond}", "yellow")
    return text


def _still_true(state: LiveChecksState) -> Text:
    """What check measurements say of the machine."""
    said = check_status(state)
    style = {"changed": "bold red", "sound": "", "unknown": "dim"}[said.verdict]
    return Text("\n".join(check_lines(said)), style)


def _position(value: float, rotary: bool = False) -> str:
    if not math.isfinite(value):
        return "–"
    return f"{math.degrees(value):.4f}°" if rotary else f"{value:.4f}"


def _micrometres(value: float, style: str) -> Text:
    if not math.isfinite(value):
        return Text("–", "dim")
    return Text(f"{1e3 * value:+.1f}", style)
