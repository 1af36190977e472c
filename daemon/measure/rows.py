"""Rows of a campaign from readings of a plan's targets, and its head."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import PART, Kind
from abbe.compcore.files.campaign_csv.head import BEGUN, SEEN
from abbe.compcore.files.formats import CAMPAIGN
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.measure.events import unit_of_kind

FEED, FEED_TURN, TOUCH_SPEED = "feed", "feed_turn", "touch_speed"
_SEEN = {FEED: "mm/min", FEED_TURN: "deg/min", TOUCH_SPEED: "mm/s"}
"""What a row says beside the signals → its unit."""
_UNIT_VECTOR = ("ux", "uy", "uz")
_TOOL = ("tool_x", "tool_y", "tool_z")


def columns(
    machine: Machine,
    setups: Sequence[PlannedSetup],
    signals: Sequence[str],
    more: Sequence[str] = (),
    seen: Sequence[str] = (),
) -> tuple[str, ...]:
    """The columns of the campaign of some set-ups, `more` and `seen` among them."""
    axes = machine.structure.axes
    base = ("base",) if any(s.kind == Kind.DISTANCE for s in setups) else ()
    directions = tuple(f"{a}_dir" for a in axes)
    first = ("time", "setup", "kind", *axes, *directions, *_TOOL, *_UNIT_VECTOR)
    return (*first, *base, "value", "sd", *more, *signals, *seen)


def seen_beside(machine: Machine, signals: Collection[str], *, touches: bool) -> tuple[str, ...]:
    """The columns of what is seen beside the signals that are read: how fast the machine came.

    A signal of that name is the user's: one that is read, or is declared in another unit, stays.
    """
    linear, rotary = machine.structure.linear, machine.structure.rotary
    came = {FEED: linear, FEED_TURN: rotary}
    names = (TOUCH_SPEED,) if touches else tuple(name for name, axes in came.items() if axes)
    declared = machine.signals
    return tuple(
        name
        for name in names
        if name not in signals and (name not in declared or declared[name].unit == _SEEN[name])
    )


def head(
    machine: Machine,
    setups: Sequence[PlannedSetup],
    conditions: Mapping[str, str],
    begun: Mapping[str, str],
    now: datetime,
    seen: Sequence[str] = (),
) -> dict[str, Any]:
    """The metadata of a campaign that begins now, with the columns `seen` beside its signals."""
    titles = dict.fromkeys(s.instrument.title for s in setups)
    made: dict[str, Any] = {
        "format": CAMPAIGN,
        "machine": machine.name,
        "date": now.date().isoformat(),
        "instrument": ", ".join(titles),
        **conditions,
        BEGUN: {**begun, **({SEEN: list(seen)} if seen else {})},
        "setups": {s.name: {"free": list(s.free)} for s in setups},
    }
    bases = {_base(s): {"position": [float(x) for x in s.base]} for s in setups if s.base}
    return made | ({"bases": bases} if bases else {})


def _base(setup: PlannedSetup) -> str:
    return f"B_{setup.name}"


def part_name(setup: str, part: int) -> str:
    """The name of a set-up's rows with its first, second, … zero."""
    return setup if part < 2 else f"{setup}{PART}{part}"


def rows_of(
    setup: PlannedSetup,
    part: int,
    target: int,
    place: Mapping[str, float],
    values: Sequence[float],
    directions: Mapping[str, float],
    time: float,
    sds: Sequence[float],
    signals: Mapping[str, float],
    seen: Mapping[str, float | None],
) -> list[dict[str, str | float | None]]:
    """The rows of one target, one for each direction that was read.

    Parameters
    ----------
    place
        Axis → where it stood, as the file holds it, in mm or rad.
    values
        Errors or distances, mm or rad; NaN: not known yet.
    time
        s since the campaign's start.
    sds
        Their standard uncertainties, mm or rad.
    seen
        What is seen beside the signals: how fast the machine came; None: it was not seen.
    """
    _, scale = unit_of_kind(setup.kind)
    common: dict[str, str | float | None] = {
        "time": round(time, 3),
        "setup": part_name(setup.name, part),
        "kind": setup.kind.name.lower(),
        **{a: written(a, q) for a, q in place.items()},
        **{f"{a}_dir": s for a, s in directions.items()},
        **dict(zip(_TOOL, setup.offset, strict=True)),
        **seen,
        **{name: round(value, 4) for name, value in signals.items()},
    }
    made = []
    digits = 9 if setup.kind == Kind.DISTANCE else 4
    for k, value in enumerate(values):
        row = dict(common)
        if setup.kind == Kind.DISTANCE:
            row["base"] = _base(setup)
        else:
            u = setup.u[target][k] / np.linalg.norm(setup.u[target][k])
            row |= {name: round(float(x), 10) for name, x in zip(_UNIT_VECTOR, u, strict=True)}
        row["value"] = None if math.isnan(value) else round(value * scale, digits)
        row["sd"] = round(sds[k] * scale, digits) or 10.0**-digits
        made.append(row)
    return made


def written(axis: str, position: float) -> float:
    """A position as the file holds it, mm or degrees."""
    return round(math.degrees(position) if is_rotary(axis) else position, 6)


def read_back(axis: str, cell: str) -> float:
    """A position of the file, mm or rad."""
    return math.radians(float(cell)) if is_rotary(axis) else float(cell)


def digest(data: object) -> str:
    """SHA-256 of what a TOML file says, whatever its comments and its order of keys."""
    text = json.dumps(data, sort_keys=True, ensure_ascii=False, default=str)
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()
