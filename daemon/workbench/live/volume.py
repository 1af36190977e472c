"""The volume of a run at present: its errors at the temperatures, tool and angles that it says."""

from __future__ import annotations

import math
from typing import Any

from abbe.compcore.figures.volume import enlargement, volume
from abbe.compcore.model.error_volume import error_volume
from abbe.compcore.model.model import Model
from abbe.daemon.report.page import plain
from abbe.daemon.status.run_status import RunStatus


def present_volume(status: RunStatus, model: Model) -> dict[str, Any]:
    """One object for the page: the figure, and what it shows, in words."""
    signals = {
        n: s.value
        for n, s in status.signals.items()
        if s.value is not None and n in model.machine.signals
    }
    at = {
        n: math.radians(a.indicated) if a.unit == "deg" else a.indicated
        for n, a in status.axes.items()
        if a.indicated is not None and n in model.machine.axes
    }
    found = error_volume(
        model, at, signals=signals, tool=status.tool_mm, time=status.cycle.running_s
    )
    where = ", ".join(
        f"{a} {v:.0f}" for a, v in zip(found.axes, found.worst, strict=True) if a
    ).replace("-", "−")
    return {
        "figure": plain(volume(found)),
        "title": f"Without correction the machine errs by up to {found.largest * 1e3:.1f} µm",
        "words": f"Most at {where} mm. {_warmth(status)} The box and the arrows are drawn "
        f"{_thousands(enlargement(found))} times too large; grey is the box as indicated.",
        "at": status.at.isoformat(timespec="seconds"),
    }


def _warmth(status: RunStatus) -> str:
    """At which temperatures, in one sentence."""
    warm = [s.value for s in status.signals.values() if s.temperature and s.value is not None]
    if not warm:
        return "At the reference temperature: no thermometer is read."
    low, high = min(warm), max(warm)
    return f"At the present temperatures, {low:.1f} to {high:.1f} °C.".replace("-", "−")


def _thousands(value: float) -> str:
    """In two significant digits, in groups of three."""
    power = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{round(value / power) * power:,.0f}"
