"""What lies outside of what was measured, as JSON; lengths mm, the rest in its own unit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from abbe.compcore.model.measured_ranges import OutsideMeasured


def outside_json(beyond: Iterable[OutsideMeasured]) -> list[dict[str, Any]]:
    """Name, value, least and greatest that was measured, and unit of each."""
    return [
        {"name": b.name, "value": b.value, "measured": [b.low, b.high], "unit": b.unit}
        for b in beyond
    ]
