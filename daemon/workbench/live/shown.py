"""What the live page shows of a run: the words and numbers of ``abbe status``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from abbe.compcore.model.model import Model
from abbe.compcore.sentences import sentences_in
from abbe.daemon.status.run_status import AxisStatus, RunStatus
from abbe.daemon.status.text import axis_cells, check_lines, cycle_line, link_line, signal_cells

_STALE = 6
"""Place of an axis's cell that says that its position is old."""


def shown_run(status: RunStatus, model: Model | None) -> dict[str, Any]:
    """One object for the page.

    Parameters
    ----------
    status
        What the run says.
    model
        Its model, for where sensors sit; None where it cannot be read.
    """
    found = {
        "machine": status.machine or "Machine",
        "at": status.at.isoformat(timespec="milliseconds"),
        "state": status.state,
        "light": _light(status),
        "faults": [f"{what}: {why}" for what, why in status.faults.items()],
        "less_sure": list(status.beyond),
        "checks": [] if status.checks is None else list(check_lines(status.checks)),
        "axes": {name: shown_axis(name, axis) for name, axis in status.axes.items()},
        "signals": [_signal(name, status, model) for name in status.signals],
        "links": [
            {"words": link_line(name, link), "light": "good" if link.state == "up" else "bad"}
            for name, link in status.links.items()
        ],
        "cycle": cycle_line(status),
        "switches": [f"{switch}: {n}" for n, switch in status.switches.items() if switch != "on"],
        "files": [
            [f.role, Path(f.path).name, f.sha256, "another one on disk" if f.differs else ""]
            for f in status.files
        ],
        "events": [
            [f"{e.time:%Y-%m-%d %H:%M:%S}", e.level, e.text] for e in reversed(status.events[-8:])
        ],
    }
    return {**found, "sentences": sentences_in([found["links"], found["cycle"]])}


def _light(status: RunStatus) -> str:
    if status.in_full:
        return "good"
    return "bad" if "NOT CORRECTED" in status.state or not status.alive else "warning"


def shown_axis(name: str, axis: AxisStatus) -> dict[str, Any]:
    """An axis as `axis_cells` has it, with what an independent measurement says of it."""
    cells = axis_cells(name, axis)
    found = {
        "indicated": _signed(cells[1]),
        "corrected": _signed(cells[2]),
        "correction": _signed(cells[3]),
        "sure": cells[4],
        "guard": cells[5],
        "light": "good" if axis.guard == "active" else "warning" if axis.guard else "",
        "stale": cells[_STALE] if len(cells) > _STALE else "",
    }
    if axis.reference is not None and axis.corrected is not None and axis.indicated is not None:
        factor, unit = (1e3, "µm") if axis.unit == "mm" else (math.radians(1.0) * 1e6, "µrad")
        before = (axis.reference - axis.indicated) * factor
        after = (axis.reference - axis.corrected) * factor
        found["measured"] = _signed(f"{before:+.1f} {unit} before, {after:+.1f} {unit} after")
    return found


def moved(status: RunStatus, cycle: Mapping[str, Any]) -> dict[str, Any]:
    """The axes of a streamed cycle, in the words of the status that came before it."""
    axes = {}
    for name, axis in status.axes.items():
        indicated = cycle["indicated"].get(name)
        if indicated is None or axis.stale:
            continue  # the status says how old it is
        newer = axis.model_copy(
            update={
                "indicated": indicated,
                "corrected": cycle["corrected"].get(name),
                "correction": cycle["correction"].get(name),
                "guard": cycle["guard"].get(name),
                # was measured at another moment
                "reference": None,
            }
        )
        axes[name] = shown_axis(name, newer)
    return {"cycle": cycle["cycle"], "axes": axes}


def _signal(name: str, status: RunStatus, model: Model | None) -> dict[str, Any]:
    cells = signal_cells(name, status.signals[name])
    known = None if model is None else model.machine.signals.get(name)
    return {
        "name": name,
        "where": "" if known is None else known.location or known.role,
        "value": _signed(cells[1]),
        "age": cells[2],
        "stale": cells[3] if len(cells) > 3 else "",
    }


_NOTHING = re.compile(r"(?<![\d.])[-+](0(?:\.0+)?)(?![\d.])")
"""A zero with a sign: what is shown of a number that is less than its last digit."""


def _signed(text: str) -> str:
    """With a true minus sign, and none before a zero."""
    return _NOTHING.sub(r"\1", text).replace("-", "−")
