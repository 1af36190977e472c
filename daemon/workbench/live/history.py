"""The past of a run as the page draws it, from its records, thinned before it is sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from abbe.compcore.errors import InputError
from abbe.compcore.model.model import Model
from abbe.compcore.units import display
from abbe.daemon.records.reading import Records, opened
from abbe.daemon.records.recorder import BEYOND, IN_FULL

MOST = 2000
"""Values of a picture at most: means; the least and the greatest beside each."""
_FINEST = 600
"""Spans of time in a picture at most: a screen shows no more."""
_GAP = 3.0
"""So many times the usual distance without a value is a gap."""


@dataclass(frozen=True)
class HistoryPicture:
    """Series that are drawn over each other.

    Attributes
    ----------
    name, title
        For the server; for people.
    unit, factor
        In which they are shown, and what the records' unit is in it.
    series
        Name in the records → name for people.
    """

    name: str
    title: str
    unit: str
    factor: float
    series: dict[str, str]


def pictures(records: Records, model: Model | None) -> list[HistoryPicture]:
    """The pictures that records have something for, what matters most first."""
    there = dict(sorted(records.series().items()))
    groups: list[tuple[str, str, str]] = [
        ("corrections", "Corrections", "correction_"),
        ("sure", "How sure: ± of the correction, k = 2", "plus_minus_"),
        ("checks", "Check points: read beyond what was expected", "check_"),
    ]
    found = []
    for name, title, begins in groups:
        for unit in dict.fromkeys(u for n, u in there.items() if n.startswith(begins)):
            shown, factor = _unit(unit)
            own = {n: n.removeprefix(begins) for n, u in there.items()
                   if n.startswith(begins) and u == unit}  # fmt: skip
            if name == "sure":
                # of a direction that no axis takes back nothing is corrected
                taken = {n: d for n, d in own.items() if f"correction_{d}" in there}
                own = taken or own
            more = "" if shown == "µm" else ", rotations"
            found.append(HistoryPicture(f"{name}-{unit}", title + more, shown, factor, own))
    warm = {n: _place(n, model) for n, u in there.items()
            if u == "degC" and not n.startswith(BEYOND)}  # fmt: skip
    if warm:
        found.insert(1, HistoryPicture("temperatures", "Temperatures", "°C", 1.0, warm))
    if IN_FULL in there:
        found.append(
            HistoryPicture(IN_FULL, "Corrected in full", "%", 100.0, {IN_FULL: "share of the time"})
        )
    times = {n: words for n, words in (("cycle", "one cycle"), ("age", "age of the positions"))
             if there.get(n) == "ms"}  # fmt: skip
    if times:
        found.append(HistoryPicture("times", "The cycle", "ms", 1.0, times))
    return found


def _unit(unit: str) -> tuple[str, float]:
    """Small lengths and angles are shown in µm and µrad."""
    known = {"mm": ("µm", 1e3), "rad": ("µrad", 1e6), "um": ("µm", 1.0), "urad": ("µrad", 1.0)}
    return known.get(unit) or display(unit)


def _place(name: str, model: Model | None) -> str:
    signal = None if model is None else model.machine.signals.get(name)
    return f"{name}, {signal.location}" if signal is not None and signal.location else name


def overview(path: Path, model: Model | None) -> dict[str, Any]:
    """From when to when there are records, and which pictures can be asked for.

    Raises
    ------
    InputError
        When there are none, or they are damaged.
    """
    with opened(path) as records:
        return {
            "range": records.range(),
            "pictures": [
                {
                    "name": p.name,
                    "title": p.title,
                    "unit": p.unit,
                    "series": list(p.series.values()),
                }
                for p in pictures(records, model)
            ],
        }


def one_picture(
    path: Path, model: Model | None, name: str, first: float, last: float
) -> dict[str, Any]:
    """One picture between two times: at most `MOST` means, with the least and greatest of each.

    Raises
    ------
    InputError
        For a picture that there is not, or times the wrong way round.
    """
    if not first < last:
        raise InputError("the beginning is not before the end", field="first", found=first)
    with opened(path) as records:
        asked = next((p for p in pictures(records, model) if p.name == name), None)
        if asked is None:
            raise InputError("no such picture", field="picture", found=name)
        names = list(asked.series)
        spans = max(2, min(_FINEST, MOST // len(names)))
        thin = records.thinned(first, last, names, spans)
    time, cut = _with_gaps(thin.time)
    series = []
    for own in names:
        values = thin.values[own]
        parts = [[None if v is None else round(v[k] * asked.factor, 4) for v in values]
                 for k in range(3)]  # fmt: skip
        least, mean, greatest = (_cut(part, cut) for part in parts)
        series.append({"least": least, "mean": mean, "greatest": greatest})
    return {"first": first, "last": last, "time": [round(t, 3) for t in time], "series": series}


def _with_gaps(time: Sequence[float]) -> tuple[list[float], list[int]]:
    """Times with one more in each gap, and after which of the old ones these stand."""
    steps = sorted(b - a for a, b in pairwise(time))
    usual = steps[len(steps) // 2] if steps else 0.0
    found, cut = list(time[:1]), []
    for k, (a, b) in enumerate(pairwise(time)):
        if b - a > _GAP * usual:
            found.append(0.5 * (a + b))
            cut.append(k)
        found.append(b)
    return found, cut


def _cut(values: Sequence[float | None], cut: Sequence[int]) -> list[float | None]:
    places = set(cut)
    found: list[float | None] = []
    for k, value in enumerate(values):
        found.append(value)
        if k in places:
            found.append(None)
    return found
