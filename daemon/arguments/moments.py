"""Moments as people type them: a date, a time of today, or so long ago."""

from __future__ import annotations

import re
from datetime import datetime, timedelta

from abbe.compcore.errors import InputError

_AGO = re.compile(r"-?(\d+(?:\.\d+)?)\s*(s|min|h|d)(?:\s+ago)?")
_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
_CLOCK = re.compile(r"\d{1,2}:\d{2}(:\d{2}(\.\d+)?)?")


def moment(text: str, field: str, now: datetime | None = None) -> float:
    """A moment, s since 1970.

    Parameters
    ----------
    text
        ``2026-11-22 14:03``, ``2026-11-22T14:03:20+01:00``, ``14:03`` (today), ``2h``, ``30min``,
        ``7d`` (ago), ``now``. Without a zone the computer's counts.
    field
        The option, for the message.
    now
        Default the present time.

    Raises
    ------
    InputError
        When it is none of these.
    """
    now = now or datetime.now().astimezone()
    word = text.strip()
    if word == "now":
        return now.timestamp()
    if ago := _AGO.fullmatch(word):
        return (now - timedelta(seconds=float(ago[1]) * _UNITS[ago[2]])).timestamp()
    try:
        if _CLOCK.fullmatch(word):
            hour, rest = word.split(":", 1)
            word = f"{now:%Y-%m-%d} {int(hour):02d}:{rest}"
        return datetime.fromisoformat(word).astimezone().timestamp()
    except (ValueError, OverflowError):
        raise InputError(
            "not a moment",
            field=field,
            found=text,
            expected="e.g. '2026-11-22 14:03', 14:03, 2h, 30min, 7d or now",
        ) from None
