"""The answers of ``abbe records``: what is kept, what was between two times, what made a part."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from io import StringIO
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.text.atomic import write_atomically
from abbe.daemon.records.reading import RecordedSpan, Records
from abbe.daemon.records.writer import EventRow, RunRow
from abbe.daemon.status_word import Status

_UM = 1e3
_SHOWN = 12


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


def between(records: Records, first: float, last: float, names: Sequence[str]) -> Iterator[str]:
    """Least, mean and greatest of each series between two times, and what was said."""
    yield f"{clock(first)} to {clock(last)}"
    yield from _spans(records.spans(first, last, names))
    events = records.events(first, last)
    yield f"events: {len(events)}"
    yield from (_event(event) for event in events[-20:])


def part(records: Records, first: float, last: float) -> dict[str, Any]:
    """Everything that made a part between two times, ready for JSON.

    Which model and configuration corrected it, what the corrections and temperatures were, in how
    much of the time it was corrected in full, and every warning.
    """
    spans = records.spans(first, last)
    full = (
        [
            bool(int(value) & Status.COMPENSATING)
            for _, _, value, _, _ in records.values(first, last, ["status"])
        ]
        if "status" in records.series()
        else []
    )
    warnings = records.events(first, last, ("WARNING", "ERROR", "CRITICAL"))
    return {
        "from": clock(first),
        "to": clock(last),
        "runs": [_run_json(run) for run in records.runs(first, last)],
        "kept": bool(spans),
        "corrected_in_full": round(sum(full) / len(full), 4) if full else None,
        "series": [
            {
                "name": s.name,
                "unit": s.unit,
                "least": s.least,
                "mean": s.mean,
                "greatest": s.greatest,
            }
            for s in spans
        ],
        "warnings": [{"time": clock(e.time), "message": e.message} for e in warnings],
    }


def part_text(found: Mapping[str, Any], spans: Sequence[RecordedSpan]) -> Iterator[str]:
    """The trace of a part, for people."""
    yield f"{found['from']} to {found['to']}"
    if not found["kept"]:
        yield "nothing was recorded in this time: nobody knows how the part was corrected"
    for run in found["runs"]:
        yield (
            f"model {Path(run['model']).name} (SHA-256 {run['model_sha256'][:_SHOWN]}), "
            f"configuration {Path(run['configuration']).name} "
            f"(SHA-256 {run['configuration_sha256'][:_SHOWN]}), Abbe {run['abbe']}, "
            f"since {run['began']}"
        )
    share = found["corrected_in_full"]
    if share is not None:
        yield f"corrected in full: {100.0 * share:.4g} % of what was recorded"
    yield from _spans(spans)
    yield f"warnings: {len(found['warnings'])}"
    yield from (f"  {w['time']}  {w['message']}" for w in found["warnings"])


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


def _spans(spans: Sequence[RecordedSpan]) -> Iterator[str]:
    if not spans:
        return
    width = max(len(s.name) for s in spans)
    yield f"{'':{width}}  {'least':>12} {'mean':>12} {'greatest':>12}"
    for s in spans:
        unit, scale = (
            ("µm", _UM)
            if s.name.startswith("correction_") and s.unit == "mm"
            else (
                s.unit,
                1.0,
            )
        )
        if s.name == "status":
            continue
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


def _run_json(run: RunRow) -> dict[str, str]:
    return {
        "began": clock(run.began),
        "abbe": run.abbe,
        "machine": run.machine,
        "configuration": run.configuration,
        "configuration_sha256": run.configuration_sha256,
        "model": run.model,
        "model_sha256": run.model_sha256,
    }


def _event(event: EventRow) -> str:
    return f"  {clock(event.time)}  {event.level.lower():7} {event.message}"
