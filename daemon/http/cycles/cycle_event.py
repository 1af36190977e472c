"""Cycles as events of a stream: what a client gets of each, put into words once for all clients."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict

from abbe.daemon.http.exchange.wire import Cycle

_MICRO, _MILLI = 1e6, 1e3


class StreamedCycle(BaseModel):
    """One cycle of the stream. Positions in mm (rotary: degrees); null where not to be believed."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)

    cycle: int
    """Its number, since the start; numbers are missing where `every` leaves cycles out."""
    time: float
    """s since the start."""
    indicated: dict[str, float | None]
    """By axis, as the controller has it."""
    corrected: dict[str, float | None]
    """By axis, indicated + correction."""
    correction: dict[str, float | None]
    """By direction, as the guard hands it out, µm (rotary: µrad)."""
    guard: dict[str, str]
    """By direction: off, rising, active, holding, falling."""
    in_full: bool
    """Whether every direction is corrected in full, and the controller took it."""
    status_word: int
    """As written to the controller."""
    cycle_ms: float
    """From the poll to the write-back."""
    age_ms: float | None
    """How old the oldest position can have been when it was about to be written."""
    signals: dict[str, float | None]
    """Last good values, in their own units."""
    stale: list[str]
    """Signals whose value is not fresh and good."""
    faults: dict[str, str]
    """What is wrong → why."""


class CycleEvents:
    """Makes events of cycles.

    Parameters
    ----------
    setup
        What the run says of the order of axes and directions.
    """

    def __init__(self, setup: Mapping[str, Any]) -> None:
        rotary = set(setup["rotary"])
        turn = math.degrees(1.0)
        self._axes = [(a, turn if a in rotary else 1.0) for a in setup["axes"]]
        self._corrected = [(a, turn if a in rotary else 1.0) for a in setup["corrected_axes"]]
        self._directions = [(d, _MICRO if d in rotary else _MILLI) for d in setup["directions"]]
        self._signals: dict[str, float | None] = {}
        self._stale: list[str] = []

    def __call__(self, cycle: Cycle) -> bytes:
        """A `StreamedCycle` as JSON."""
        if cycle.signals is not None:
            self._signals = {n: _known(value, 4) for n, (value, _) in cycle.signals.items()}
            self._stale = [n for n, (_, good) in cycle.signals.items() if not good]
        names = [name for name, _ in self._directions]
        event = {
            "cycle": cycle.number,
            "time": round(cycle.time, 4),
            "indicated": _by_name(self._axes, cycle.indicated, 6),
            "corrected": _by_name(self._corrected, cycle.corrected, 6),
            "correction": _by_name(self._directions, cycle.correction, 4),
            "guard": dict(zip(names, cycle.states, strict=True)),
            "in_full": cycle.in_full,
            "status_word": cycle.status,
            "cycle_ms": round(_MILLI * cycle.duration, 3),
            "age_ms": _known(_MILLI * cycle.age, 3),
            "signals": self._signals,
            "stale": self._stale,
            "faults": cycle.faults,
        }
        return json.dumps(event, ensure_ascii=False).encode()


def _by_name(
    names: Sequence[tuple[str, float]], values: Sequence[float], digits: int
) -> dict[str, float | None]:
    return {
        name: _known(value * factor, digits)
        for (name, factor), value in zip(names, values, strict=True)
    }


def _known(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
