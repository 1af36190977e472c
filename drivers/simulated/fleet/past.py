"""What the checks of a machine said until yesterday, and where its spheres stand by that."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from typing import Final

from abbe.drivers.simulated.bridge.checks import DAY, SPHERES, WhatHappens, year_of_checks
from abbe.drivers.simulated.bridge.machine import AXES

SOUND, SINCE = 40, 2
"""Checks of a sound machine, and those since something happened: one more, and it is noticed."""
_MM: Final = 1e-3


def past_checks(seed: int, number: int, what: WhatHappens, now: float) -> str:
    """A campaign file's text: forty-two working days, the last of them yesterday.

    Parameters
    ----------
    seed, number
        Which machine, and which of the fleet: another weather, another scatter.
    what
        What has happened to it two checks ago.
    now
        s since 1970.
    """
    text = year_of_checks(seed, what, at=SOUND, checks=SOUND + SINCE, year=number)
    head, rows = _split(text)
    shift = now - DAY - max(float(row[0]) for row in rows)
    return head + "".join(f"{float(t) + shift:.0f},{','.join(rest)}\n" for t, *rest in rows)


def stands(checks: str) -> Mapping[str, tuple[float, ...]]:
    """Where each sphere is: found first at its place, with the error that was read then, mm."""
    head, rows = _split(checks)
    columns = head.rstrip().rpartition("\n")[2].split(",")
    setup, value = columns.index("setup"), columns.index("value")
    first: dict[str, float] = {}
    for row in rows:
        first.setdefault(row[setup], float(row[value]))
    return {
        name: tuple(q + _MM * first[f"{name}_{axis}"] for q, axis in zip(place, AXES, strict=True))
        for name, place in SPHERES.items()
    }


def _split(text: str) -> tuple[str, list[list[str]]]:
    """The head with the line of columns, and the rows."""
    lines = text.splitlines(keepends=True)
    head = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    return "".join(lines[:head]), list(csv.reader(lines[head:]))
