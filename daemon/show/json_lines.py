"""JSON lines: one object a cycle, as ``abbe run --json`` and ``abbe demo --json`` print them."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.uncertainty import COVERAGE
from abbe.daemon.guard import DIRECTIONS
from abbe.daemon.pipeline.live_uncertainty import LiveUncertainty
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.show.writer import LineWriter
from abbe.drivers.link import Link


class JsonLines:
    """A listener that writes every cycle.

    Parameters
    ----------
    writer
        Where to.
    machine
        For the units of axes and signals.
    axes, corrected_axes
        Order of a record's positions.
    links
        Shown with their state.
    sure
        Says how sure the correction is.
    """

    def __init__(
        self,
        writer: LineWriter,
        machine: Machine,
        axes: tuple[str, ...],
        corrected_axes: tuple[str, ...],
        links: Mapping[str, Link],
        sure: LiveUncertainty | None = None,
    ) -> None:
        self._writer = writer
        self._sure = sure
        self._axes = [_shown(machine, a) for a in axes]
        self._corrected = [_shown(machine, a) for a in corrected_axes]
        self._temperatures = {s.name for s in machine.signals.values() if s.temperature}
        self._links = links

    def __call__(self, record: CycleRecord) -> None:
        """Hand a cycle to the writer."""
        line = self.line(record)
        if self._writer.dropped:
            line["dropped"] = self._writer.dropped
        self._writer.put(json.dumps(line, ensure_ascii=False))

    def line(self, record: CycleRecord) -> dict[str, Any]:
        """One cycle as an object."""
        temperatures: dict[str, float | None] = {}
        others: dict[str, float | None] = {}
        for name, reading in record.signals.items():
            value = _number(reading.value, 4)
            (temperatures if name in self._temperatures else others)[name] = value
        decision, now = record.decision, time.monotonic()
        line = {
            "cycle": record.number,
            "time": round(record.time, 4),
            "unit": "mm",
            "indicated": _positions(self._axes, record.indicated),
            "corrected": _positions(self._corrected, record.corrected),
            "correction": {
                d: round(c, 6) if d in DIRECTIONS else round(math.degrees(c), 9)
                for d, c in zip(record.directions, decision.correction, strict=True)
            },
            "temperatures": temperatures,
            "guard": {
                "states": {
                    d: s.value for d, s in zip(record.directions, decision.states, strict=True)
                },
                "compensating": decision.compensating,
                "size_limited": decision.size_limited,
                "rate_limited": decision.rate_limited,
                "status": record.status,
            },
            "faults": record.faults,
            "links": {
                name: {
                    "state": link.status.state.value,
                    "for_s": round(now - link.status.since, 3),
                    "round_trip_ms": _number(1e3 * link.status.round_trip, 3),
                }
                for name, link in self._links.items()
            },
            "written": record.written,
            "cycle_ms": round(1e3 * record.duration, 3),
            "age_ms": _number(1e3 * record.age, 3),
            "lag_um": {
                axis: _number(1e3 * record.age * speed * factor, 3)
                for (axis, factor, _), speed in zip(self._axes, record.speeds, strict=False)
            },
        }
        stale = {n: r for n, r in record.signals.items() if r.fault}
        if stale:
            line["stale"] = {n: _number(now - r.time, 3) for n, r in stale.items()}
        if self._sure is not None and (latest := self._sure.latest) is not None:
            line["uncertainty"] = {
                **{d: round(1e3 * w, 3) for d, w in zip(DIRECTIONS, latest.wide, strict=True)},
                "unit": "um",
                "k": COVERAGE,
                "beyond": [b.name for b in latest.beyond],
            }
        if others:
            line["signals"] = others
        if any(map(math.isfinite, record.reference)):
            line["reference"] = _positions(self._axes, record.reference)
        if record.shown is not None:
            line["shown"] = {d: round(c, 6) for d, c in zip(DIRECTIONS, record.shown, strict=True)}
        if record.pose is not None:
            line["orientation_left"] = {
                "direction": round(1e6 * record.pose.direction_left, 3),
                "spin": round(1e6 * record.pose.spin_left, 3),
                "near_pole": record.pose.damped,
                "limited": record.pose.limited,
            }
        return line


_Shown = tuple[str, float, int]
"""An axis, its factor from the inside to what is shown, and the digits of that."""


def _shown(machine: Machine, axis: str) -> _Shown:
    return (axis, math.degrees(1.0), 9) if machine.axes[axis].rotary else (axis, 1.0, 6)


def _positions(axes: Sequence[_Shown], values: Sequence[float]) -> dict[str, float | None]:
    """By axis: mm, rotary axes in degrees; null where not to be believed."""
    return {
        axis: _number(value * factor, digits)
        for (axis, factor, digits), value in zip(axes, values, strict=True)
    }


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
