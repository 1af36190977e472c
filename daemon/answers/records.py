"""The answers of ``abbe records``: what is kept, what was between two times, what made a part."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from datetime import datetime
from io import StringIO
from pathlib import Path

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.text.atomic import write_atomically
from abbe.daemon.records.reading import RecordedSpan, Records
from abbe.daemon.records.writer import EventRow, RunRow

_UM = 1e3
_SHOWN = 12
_EVENTS = 20
"""Events that are shown of many."""
_SMALL = ("correction_", "plus_minus_")
BITS = frozenset({"status", "outside"})
"""Series of bits, of which least, mean and greatest say nothing."""


def clock(time: float) -> str:
    """A moment for people, in the computer's zone."""
    return datetime.fromtimestamp(time).astimezone().isoformat(" ", "seconds")


def summary(records: Records) -> Iterator[str]:
    """What is kept, in a few lines."""
    found = records.range()
    if found is None:
        yield "nothing is kept yet"
        return
    first, last = found
    yield f"from {clock(first)} to {clock(last)}"
    yield from _runs(records.runs(first, last)[-3:])
    yield "series: " + ", ".join(
        f"{name} ({unit})" if unit else name for name, unit in records.series().items()
    )


def between(
    records: Records,
    first: float,
    last: float,
    names: Sequence[str],
    levels: Sequence[str] = (),
) -> Iterator[str]:
    """Least, mean and greatest of each series between two times, and the last events.

    `levels`: only events of these; empty: of all.
    """
    yield f"{clock(first)} to {clock(last)}"
    yield from span_lines(records.spans(first, last, names))
    events = records.events(first, last, levels)
    older = f", the last {_EVENTS}" if len(events) > _EVENTS else ""
    yield f"events: {len(events)}{older}"
    yield from (_event(event) for event in events[-_EVENTS:])


def export_csv(
    records: Records, path: Path, first: float, last: float, names: Sequence[str]
) -> int:
    """Write values as CSV, one line each; returns how many."""
    count = 0

    def lines() -> Iterator[str]:
        nonlocal count
        units = records.series()
        yield "time,series,unit,least,mean,greatest\n"
        for time, name, least, mean, greatest in records.values(first, last, names):
            count += 1
            row = StringIO()
            csv.writer(row, lineterminator="\n").writerow(
                [_iso(time), name, units[name], f"{least:.9g}", f"{mean:.9g}", f"{greatest:.9g}"]
            )
            yield row.getvalue()

    write_atomically(path, lines())
    return count


def export_parquet(
    records: Records, path: Path, first: float, last: float, names: Sequence[str]
) -> int:
    """Write values as Parquet; returns how many.

    Raises
    ------
    AbbeError
        When pyarrow is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise AbbeError("Parquet needs pyarrow: pip install 'abbe[records]'") from None
    units = records.series()
    rows = list(records.values(first, last, names))
    times, series, least, mean, greatest = zip(*rows, strict=True) if rows else ((),) * 5
    table = pyarrow.table(
        {
            "time": pyarrow.array(
                [round(t * 1e6) for t in times], pyarrow.timestamp("us", tz="UTC")
            ),
            "series": pyarrow.array(series, pyarrow.string()),
            "unit": pyarrow.array([units[name] for name in series], pyarrow.string()),
            "least": pyarrow.array(least, pyarrow.float64()),
            "mean": pyarrow.array(mean, pyarrow.float64()),
            "greatest": pyarrow.array(greatest, pyarrow.float64()),
        }
    )
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(table, sink)
    write_atomically(path, sink.getvalue().to_pybytes())
    return len(rows)


def _iso(time: float) -> str:
    return datetime.fromtimestamp(time).astimezone().isoformat("T", "milliseconds")


def span_lines(spans: Sequence[RecordedSpan]) -> Iterator[str]:
    """Least, mean and greatest of series, for people; words of bits left out."""
    shown = [s for s in spans if s.name not in BITS]
    if not shown:
        return
    width = max(len(s.name) for s in shown)
    yield f"{'':{width}}  {'least':>12} {'mean':>12} {'greatest':>12}"
    for s in shown:
        small = s.name.startswith(_SMALL) and s.unit == "mm"
        unit, scale = ("µm", _UM) if small else (s.unit, 1.0)
        yield (
            f"{s.name:{width}}  {scale * s.least:12.6g} {scale * s.mean:12.6g} "
            f"{scale * s.greatest:12.6g} {unit}"
        )


def _runs(runs: Sequence[RunRow]) -> Iterator[str]:
    for run in runs:
        yield (
            f"since {clock(run.began)}: {run.machine or 'a machine'}, {Path(run.model).name} "
            f"(SHA-256 {run.model_sha256[:_SHOWN]}), Abbe {run.abbe}"
        )


def _event(event: EventRow) -> str:
    return f"  {clock(event.time)}  {event.level.lower():7} {event.message}"
