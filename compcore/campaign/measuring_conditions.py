"""The conditions under which a campaign was measured (ISO/TR 16907, 9.1), as said and as seen.

What a person writes at the top of a campaign, and where axes, tool and temperatures were in its
rows, go with the campaign: into the fitted model, the record of its tables, the journal of uploads
and every page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date, datetime, time
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.structure import is_rotary

STATED: Mapping[str, str] = {
    "machine": "Machine",
    "serial": "Serial number",
    "date": "Date",
    "operator": "Operator",
    "instrument": "Instrument",
    "environment": "Environment",
    "warm_up": "Warm-up",
    "load": "Load",
    "feed": "Feed",
    "other_axes": "Positions",
    "measuring_tool": "Measuring tool",
    "notes": "Notes",
}
"""Key at the top of a campaign → what it is called on a page."""


def plain(value: object) -> str | None:
    """A condition as text: words, a number, a date, or a list of such; None for anything else.

    >>> plain(date(2026, 3, 2)), plain(["XL-80", 4711]), plain({"a": 1})
    ('2026-03-02', 'XL-80, 4711', None)
    """
    if isinstance(value, str):
        return " ".join(value.split())
    if isinstance(value, datetime):
        return value.isoformat(" ", "minutes")
    if isinstance(value, date | time):
        return value.isoformat()
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:g}" if isinstance(value, float) else str(value)
    if isinstance(value, list | tuple):
        parts = [plain(v) for v in value]
        return None if None in parts else ", ".join(p for p in parts if p)
    return None


def stated(metadata: Mapping[str, object]) -> dict[str, str]:
    """What a person said of the conditions, by the keys of `STATED`; what is blank left out."""
    found = {key: plain(metadata[key]) for key in STATED if key in metadata}
    return {key: text for key, text in found.items() if text}


def observed(campaign: Campaign) -> dict[str, Any]:
    """What the rows themselves tell; of one file.

    Returns
    -------
    ``positions``: axis → least and greatest, mm (rotary: degrees); ``tool``: of x, y and z, mm;
    ``signals``: name → least and greatest, in its unit; ``hours``: from the first row to the last,
    absent where times are not known.
    """
    c = campaign.conditions
    positions = {}
    for axis, q in c.positions.items():
        known = q[np.isfinite(q)]
        if known.size:
            positions[axis] = _ends(np.degrees(known) if is_rotary(axis) else known)
    signals = {}
    for name, values in c.signals.items():
        known = values[np.isfinite(values)]
        if known.size:
            signals[name] = _ends(known)
    found: dict[str, Any] = {"positions": positions}
    if c.n:
        found["tool"] = [_ends(column) for column in c.tool.T]
    if signals:
        found["signals"] = signals
    if c.n and np.ptp(c.time) > 0.0:
        found["hours"] = round(float(np.ptp(c.time)) / 3600.0, 3)
    return found


def _ends(values: Any) -> list[float]:
    return [round(float(values.min()), 9), round(float(values.max()), 9)]


def of_files(campaign: Campaign) -> list[dict[str, Any]]:
    """File by file, in the order of `Campaign.files`: `stated` and `observed` together."""
    heads = list(campaign.metadata)
    found = []
    for k, rows in enumerate(by_file(campaign)):
        head = heads[k] if k < len(heads) else {}
        found.append({**stated(head), **observed(rows)})
    return found


def by_file(campaign: Campaign) -> list[Campaign]:
    """The rows of each file, in the order of `Campaign.files`; all of them where it is one."""
    run = campaign.conditions.run
    if run is None or len(campaign.files) < 2:
        return [campaign]
    first = int(run.min())
    return [campaign.rows(run == first + k) for k in range(len(campaign.files))]


def together(conditions: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """What several campaigns' conditions have in common, or what they differ in, by `STATED`."""
    found: dict[str, str] = {}
    for key in STATED:
        texts = [str(c[key]) for c in conditions if c.get(key)]
        if texts:
            found[key] = "; ".join(dict.fromkeys(texts))
    return found


def extent(conditions: Sequence[Mapping[str, Any]], of: str, name: str) -> tuple[float, float]:
    """Least and greatest of a signal or position over several campaigns; NaN where none tells.

    `of` is ``signals`` or ``positions``.
    """
    ends = [c[of][name] for c in conditions if name in c.get(of, {})]
    if not ends:
        return float("nan"), float("nan")
    return min(float(e[0]) for e in ends), max(float(e[1]) for e in ends)
