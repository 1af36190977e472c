"""Ages in words, as people say them."""

from __future__ import annotations

import math


def age_in_words(seconds: float | None) -> str:
    """A time span in its two largest units; empty where it is not known.

    >>> age_in_words(0.21), age_in_words(12.4), age_in_words(7980.0), age_in_words(200_000.0)
    ('0.2 s', '12 s', '2 h 13 min', '2 d 8 h')
    """
    if seconds is None or not math.isfinite(seconds):
        return ""
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 60:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    if hours < 24:
        return f"{hours} h {minutes} min"
    days, hours = divmod(round(seconds / 3600.0), 24)
    return f"{days} d {hours} h"
