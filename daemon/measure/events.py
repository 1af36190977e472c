"""What a measurement tells a person as it goes on, line by line."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.visits import SetupVisits


@dataclass(frozen=True, slots=True)
class MeasureEvent:
    """One thing that happened while measuring.

    Attributes
    ----------
    kind
        ``began``, ``resumed``, ``set up``, ``row``, ``next``, ``repeated``, ``missed``,
        ``unsteady``, ``lost``, ``back``, ``new zero``, ``doubt``, ``withdrawn``, ``disk``,
        ``paused``, ``done``, ``note``, ``ended``.
    text
        For people, one line.
    about
        The same in numbers.
    """

    kind: str
    text: str
    about: Mapping[str, Any] = field(default_factory=dict)


Tell = Callable[[MeasureEvent], None]


def unit_of_kind(kind: Kind) -> tuple[str, float]:
    """The unit in which a campaign holds a kind of row, and what one mm or rad is in it."""
    return {Kind.ROTATION: ("µrad", 1e6), Kind.DISPLACEMENT: ("µm", 1e3)}.get(kind, ("mm", 1.0))


def place_words(place: Mapping[str, float]) -> str:
    """Axes and where they stand: ``X 50.000, C 90.000°``."""
    return ", ".join(
        f"{axis} {math.degrees(q):.3f}°" if is_rotary(axis) else f"{axis} {q + 0.0:.3f}"
        for axis, q in place.items()
    )


def target_words(visits: SetupVisits, visit: int) -> str:
    """A visit for people: its number, where, from which side."""
    senses = visits.setup.senses()
    moving = [a for a, q in visits.setup.targets.items() if float(q.max() - q.min()) > 0.0]
    sides = {a: "from below" if senses[a][visit] > 0 else "from above" for a in moving}
    side = f", {sides[moving[0]]}" if len(moving) == 1 else ""
    return f"{visit + 1} of {visits.count}: {place_words(visits.target(visit))}{side}"


def setup_words(setup: PlannedSetup) -> str:
    """How a set-up is placed, for people."""
    stands = "; ".join(
        f"{title} at " + ", ".join(f"{x:.0f}" for x in place)
        for title, place in setup.optics.items()
    )
    words = f"{setup.name}: {setup.instrument.title}, {setup.what}"
    tool = ", ".join(f"{x:g}" for x in setup.offset)
    words += f"; tool {setup.tool} ({tool})" if setup.tool else ""
    return words + (f"; {stands} (X, Y, Z + tool, mm)" if stands else "")


def minutes(seconds: float) -> str:
    """A time that is left: ``1 h 05 min``, ``12 min``, ``40 s``."""
    if seconds < 90.0:
        return f"{max(0.0, seconds):.0f} s"
    whole = round(seconds / 60.0)
    return f"{whole} min" if whole < 60 else f"{whole // 60} h {whole % 60:02d} min"
