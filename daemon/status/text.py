"""The status of a run as text, for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from abbe.compcore.sentences import joined, said
from abbe.compcore.units import in_digits
from abbe.daemon.status.ages import age_in_words
from abbe.daemon.status.run_status import (
    AxisStatus,
    CheckStatus,
    LinkHealth,
    RunStatus,
    SignalStatus,
)

_SHA = 12
"""Digits of a SHA-256 that people are shown."""
_EVENTS = 5
_GUARD = {
    "off": "off",
    "rising": "ramped in",
    "active": "in full",
    "holding": "held",
    "falling": "ramped to zero",
}
_STATES = {
    "closed": said("closed"),
    "connecting": said("connecting"),
    "up": said("up"),
    "degraded": said("degraded"),
    "down": said("down"),
}
_UNITS = {"degC": "°C", "um": "µm", "urad": "µrad", "deg": "°"}


def check_lines(checks: CheckStatus) -> Iterator[str]:
    """What check measurements say, in a few lines."""
    if checks.verdict == "changed":
        yield checks.words[0]
        yield f"next: {checks.next}"
    elif checks.verdict == "sound" and checks.last is not None:
        full = max((s.full for s in checks.series.values()), default=0.0)
        yield (
            f"checks: sound, {checks.checks} of them, the last {checks.last:%Y-%m-%d %H:%M}, "
            f"fullest chart {full:.0%}"
        )
    else:
        yield f"checks: {checks.problem or 'none yet'}"
    for name, why in checks.refused.items():
        yield f"check {name} was not recorded: {why}"


def summary(status: RunStatus) -> str:
    """A run in one line."""
    config = next((f.path for f in status.files if f.role == "configuration"), "")
    return f"{status.machine or config}: {status.state}; process {status.owner.pid}, {config}"


def lines(status: RunStatus) -> Iterator[str]:
    """A run in full."""
    owner, cycle = status.owner, status.cycle
    yield f"{status.machine or 'no name'}: {status.state}"
    for what, why in status.faults.items():
        yield f"  {what}: {why}"
    yield ""
    yield from _table([axis_cells(n, a) for n, a in status.axes.items()], AXIS_HEADINGS)
    for words in status.beyond:
        yield f"  less sure: {words}"
    if status.checks is not None:
        yield from check_lines(status.checks)
    if any(status.tool_mm):
        x, y, z = status.tool_mm
        yield f"tool x {x:g}, y {y:g}, z {z:g} mm"
    if status.signals:
        yield ""
        yield from _table([signal_cells(n, s) for n, s in status.signals.items()])
    yield ""
    yield from (link_line(name, link) for name, link in status.links.items())
    yield cycle_line(status)
    yield f"status word {status.status_word.word:#06x}: {' '.join(status.status_word.bits)}"
    for name, switch in status.switches.items():
        if switch != "on":
            yield f"{switch}: {name}"
    yield ""
    yield (
        f"process {owner.pid} of user {owner.user} on {owner.host}, since "
        f"{owner.since:%Y-%m-%d %H:%M:%S} ({age_in_words(cycle.running_s)}); Abbe {status.abbe}"
    )
    for resource in owner.holds:
        yield f"holds {resource}"
    for file in status.files:
        differs = "; THE FILE ON DISK IS ANOTHER ONE than what runs" if file.differs else ""
        yield f"{file.role} {file.path}, SHA-256 {file.sha256[:_SHA]}{differs}"
    for event in status.events[-_EVENTS:]:
        yield f"{event.time:%Y-%m-%d %H:%M:%S} {event.level}: {event.text}"


AXIS_HEADINGS = ["axis", "indicated", "corrected", "correction", "±", "guard"]
"""What `axis_cells` gives; where a position is old, how old and why follows."""


def axis_cells(name: str, axis: AxisStatus) -> list[str]:
    """One axis in words, as `AXIS_HEADINGS` names them."""
    unit = _unit(axis.unit)
    row = [name, _number(axis.indicated, 4, unit), _number(axis.corrected, 4, unit)]
    if axis.correction is None:
        row += ["", ""]
    else:
        row.append(f"{axis.correction:+.1f} {_unit(axis.correction_unit)}")
        row.append("" if axis.uncertainty is None else f"{axis.uncertainty:.1f} µm")
    row.append(_GUARD[axis.guard] if axis.guard is not None else "not corrected")
    if axis.guard is not None and not axis.written:
        row[-1] += ", not written"
    if axis.stale:
        age = age_in_words(axis.age_s)
        row.append(f"STALE{f', {age} old' if age else ''}: {axis.fault}")
    return row


def signal_cells(name: str, signal: SignalStatus) -> list[str]:
    """One signal in words: name, value, age; where it is old, why."""
    row = [name, _number(signal.value, 2, _unit(signal.unit)), age_in_words(signal.age_s)]
    if signal.typed_in:
        row[-1] += ", typed in"
    if signal.stale:
        row.append(f"STALE: {signal.fault}")
    return row


def link_line(name: str, link: LinkHealth) -> str:
    """One link in words."""
    parts: list[str] = [
        said(
            "link {name} ({driver}) {state} for {age}",
            name=name,
            driver=link.driver,
            state=_STATES[link.state],
            age=age_in_words(link.for_s),
        )
    ]
    if link.detail:
        parts.append(link.detail)
    if link.round_trip_ms is not None:
        parts.append(f"{in_digits(link.round_trip_ms, 2)} ms")
    parts.append(
        said(
            "{requests} requests, {failures} failures",
            requests=link.requests,
            failures=link.failures,
        )
    )
    if link.reconnects:
        parts.append(said("{n} reconnects", n=link.reconnects))
    parts += [
        said("{unit} left alone: {why}", unit=unit, why=why)
        for unit, why in link.quarantined.items()
    ]
    return joined(parts, ", ")


def cycle_line(status: RunStatus) -> str:
    """The cycle in words."""
    cycle = status.cycle
    if cycle.last_ms is None:
        return said("no cycle yet")
    parts: list[str] = [
        said(
            "cycle {n}, {age} ago, {last} ms",
            n=cycle.number,
            age=age_in_words(cycle.age_s),
            last=in_digits(cycle.last_ms, 2),
        )
    ]
    if cycle.median_ms is not None and cycle.p99_ms is not None:
        parts.append(
            said(
                "half within {half} ms, 99 % within {most} ms",
                half=in_digits(cycle.median_ms, 2),
                most=in_digits(cycle.p99_ms, 2),
            )
        )
    if cycle.period_ms:
        parts.append(said("every {period} ms", period=f"{cycle.period_ms:g}"))
    if cycle.missed:
        parts.append(said("{n} left out", n=cycle.missed))
    return joined(parts)


def _number(value: float | None, digits: int, unit: str) -> str:
    return "–" if value is None else f"{value:.{digits}f} {unit}"


def _unit(unit: str) -> str:
    return _UNITS.get(unit, unit)


def _table(rows: list[list[str]], headings: list[str] | None = None) -> Iterator[str]:
    """Columns as wide as what stands in them, without empty ones; numbers on the right."""
    everything = [headings, *rows] if headings else rows
    wide: list[int] = []
    for row in everything:
        wide += [0] * (len(row) - len(wide))
        for i, cell in enumerate(row):
            wide[i] = max(wide[i], len(cell))
    numbers = range(1, 5 if headings else 2)
    used = [i for i in range(len(wide)) if any(row[i : i + 1] not in ([], [""]) for row in rows)]
    for row in everything:
        cells = [
            row[i].rjust(wide[i]) if i in numbers else row[i].ljust(wide[i])
            for i in used
            if i < len(row)
        ]
        yield "  ".join(cells).rstrip()
