"""Numbers as bars of block characters."""

from __future__ import annotations

import math
from collections.abc import Sequence

_BARS = " ▁▂▃▄▅▆▇█"
_BAR_WIDTH = 8


def sparkline(values: Sequence[float], top: float) -> str:
    """Values as bars of eighths, `top` being a full one; a gap where there is none.

    >>> sparkline([0.0, 5.0, 10.0, float("nan")], 10.0)
    '▁▄█ '
    """
    out = ""
    for value in values:
        if not math.isfinite(value):
            out += " "
        else:
            share = min(1.0, value / top) if top > 0.0 else 0.0
            out += _BARS[max(1, round(share * 8))]
    return out


def deviation_bar(value: float, full: float, width: int = _BAR_WIDTH) -> str:
    """A signed value as a bar to the left or right of a middle line.

    >>> deviation_bar(5.0, 10.0, 4), deviation_bar(-10.0, 10.0, 4)
    ('    │██  ', '████│    ')
    """
    if not math.isfinite(value) or full <= 0.0:
        return " " * width + "│" + " " * width
    length = min(width, round(abs(value) / full * width))
    bar = "█" * length
    return (
        (bar.rjust(width) if value < 0 else " " * width)
        + "│"
        + (bar.ljust(width) if value >= 0 else " " * width)
    )
