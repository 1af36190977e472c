"""The volume of a run at present: its errors at the temperatures, tool and angles that it says."""

from __future__ import annotations

import math
from typing import Any

from abbe.compcore.figures.volume import enlargement, volume
from abbe.compcore.model.error_volume import error_volume
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said, sentences_in
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
    title = said(
        "Without correction the machine errs by up to {size} µm",
        size=f"{found.largest * 1e3:.1f}",
    )
    words = said("Most at {where} mm. {warmth}", where=where, warmth=_warmth(status))
    if sum(map(bool, found.axes)) > 1:
        words = said(
            "Most at {where} mm. {warmth} The box and the arrows are drawn {times} times too "
            "large; grey is the box as indicated.",
            where=where,
            warmth=_warmth(status),
            times=_thousands(enlargement(found)),
        )
    return {
        "figure": plain(volume(found)),
        "title": title,
        "words": words,
        "sentences": sentences_in([title, words]),
        "at": status.at.isoformat(timespec="seconds"),
    }


def _warmth(status: RunStatus) -> str:
    """At which temperatures, in one sentence."""
    warm = [s.value for s in status.signals.values() if s.temperature and s.value is not None]
    if not warm:
        return said("At the reference temperature: no thermometer is read.")
    low, high = min(warm), max(warm)
    least, most = (f"{value:.1f}".replace("-", "−") for value in (low, high))
    if least == most:
        return said("At the present temperature, {low} °C.", low=least)
    return said("At the present temperatures, {low} to {high} °C.", low=least, high=most)


def _thousands(value: float) -> str:
    """In two significant digits, in groups of three."""
    power = 10.0 ** (math.floor(math.log10(value)) - 1)
    # a comma or a point would be read as a decimal mark in one language or the other
    return f"{round(value / power) * power:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
