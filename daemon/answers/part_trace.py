"""The trace of a part: what corrected it, how well, and everything that was out of range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from abbe.compcore.units import in_digits
from abbe.daemon.answers.records import BITS, clock, span_lines
from abbe.daemon.records.reading import RecordedSpan, Records
from abbe.daemon.records.recorder import BEYOND, IN_FULL
from abbe.daemon.records.writer import RunRow
from abbe.daemon.status_word import Status
from abbe.daemon.upload.history.content import short
from abbe.daemon.upload.history.upload_log import END, Entry, read_journal

_SHOWN = 12


def part(
    records: Records, first: float, last: float, uploads: Path | None = None
) -> dict[str, Any]:
    """Everything that made a part between two times, ready for JSON.

    Which model and configuration corrected it, what the corrections and temperatures were, in how
    much of the time it was corrected in full, what was outside of what was measured, which tables
    the controller had, and every warning.

    Parameters
    ----------
    records
        Of the machine.
    first, last
        When the part was begun and done, s since 1970.
    uploads
        The journal of uploads, where the configuration names one.

    Raises
    ------
    InputError
        When the journal of uploads cannot be read.
    """
    spans = records.spans(first, last)
    warnings = records.events(first, last, ("WARNING", "ERROR", "CRITICAL"))
    return {
        "from": clock(first),
        "to": clock(last),
        "runs": [_run(run) for run in records.runs(first, last)],
        "kept": bool(spans),
        "corrected_in_full": _share_in_full(records, spans, first, last),
        "series": [
            {"name": s.name, "unit": s.unit, "least": s.least, "mean": s.mean,
             "greatest": s.greatest}
            for s in _shown(spans)
        ],
        "beyond_what_was_measured": _all_beyond(spans),
        "tables": None if uploads is None else _tables(uploads, first, last),
        "warnings": [{"time": clock(e.time), "message": e.message} for e in warnings],
    }  # fmt: skip


def part_text(found: Mapping[str, Any], spans: Sequence[RecordedSpan]) -> Iterator[str]:
    """The trace of a part, for people."""
    yield f"{found['from']} to {found['to']}"
    if not found["kept"]:
        yield "nothing was recorded in this time: nobody knows how the part was corrected"
    for run in found["runs"] if found["kept"] else ():
        yield (
            f"model {Path(run['model']).name} (SHA-256 {run['model_sha256'][:_SHOWN]}), "
            f"configuration {Path(run['configuration']).name} "
            f"(SHA-256 {run['configuration_sha256'][:_SHOWN]}), Abbe {run['abbe']}, "
            f"since {run['began']}"
        )
    for change in found["tables"] or ():
        yield (
            f"tables {short(change['new'])} on the controller since {change['time']}, "
            f"by {change['who'] or 'somebody'}"
        )
    share = found["corrected_in_full"]
    if share is not None:
        yield f"corrected in full: {in_digits(100.0 * share, 4)} % of what was recorded"
    yield from span_lines(_shown(spans))
    yield from _beyond_lines(found)
    yield f"warnings: {len(found['warnings'])}"
    yield from (f"  {w['time']}  {w['message']}" for w in found["warnings"])


def _shown(spans: Sequence[RecordedSpan]) -> list[RecordedSpan]:
    """Series that a table says something of."""
    apart = BITS | {IN_FULL}
    return [s for s in spans if s.name not in apart and not s.name.startswith(BEYOND)]


def _share_in_full(
    records: Records, spans: Sequence[RecordedSpan], first: float, last: float
) -> float | None:
    for span in spans:
        if span.name == IN_FULL:
            return round(span.mean, 4)
    # records of before that series was kept
    if "status" not in records.series():
        return None
    words = [int(value) for _, _, value, _, _ in records.values(first, last, ["status"])]
    full = sum(bool(word & Status.COMPENSATING) for word in words)
    return round(full / len(words), 4) if words else None


def _all_beyond(spans: Sequence[RecordedSpan]) -> list[dict[str, Any]] | None:
    """All that was outside; None where nobody knows what was measured."""
    if not any(s.name == "outside" for s in spans):
        return None
    return [_beyond(s, spans) for s in spans if s.name.startswith(BEYOND)]


def _beyond_lines(found: Mapping[str, Any]) -> Iterator[str]:
    beyond = found["beyond_what_was_measured"]
    if not found["kept"]:
        return
    if beyond is None:
        yield "outside of what was measured: not known, the model does not say what was measured"
        return
    yield f"outside of what was measured: {len(beyond) or 'nothing'}"
    for b in beyond:
        share, most = in_digits(100.0 * b["share"]), in_digits(b["by"], sign=True)
        yield f"  {b['name']}: by up to {most} {b['unit']}, in {share} % of the time"


def _beyond(span: RecordedSpan, spans: Sequence[RecordedSpan]) -> dict[str, Any]:
    """How far, and in how much of what was recorded, something was outside."""
    kept = max(s.count for s in spans)
    return {
        "name": span.name.removeprefix(BEYOND),
        "by": max(span.least, span.greatest, key=abs),
        "unit": span.unit,
        "share": round(span.count / kept, 4),
    }


def _tables(journal: Path, first: float, last: float) -> list[dict[str, Any]]:
    """Uploads that made other tables active: the last one before the part, and those during it."""
    before: list[Entry] = []
    during: list[Entry] = []
    for entry in read_journal(journal).entries:
        if entry["step"] == END and entry.get("active") == "new":
            at = datetime.fromisoformat(entry["time"]).timestamp()
            if at < first:
                before = [entry]
            elif at <= last:
                during.append(entry)
    keys = ("time", "who", "old", "new", "model", "abbe")
    return [{key: entry.get(key) for key in keys} for entry in (*before, *during)]


def _run(run: RunRow) -> dict[str, str]:
    return {
        "began": clock(run.began),
        "abbe": run.abbe,
        "machine": run.machine,
        "configuration": run.configuration,
        "configuration_sha256": run.configuration_sha256,
        "model": run.model,
        "model_sha256": run.model_sha256,
    }
