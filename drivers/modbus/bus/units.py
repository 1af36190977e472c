"""The units on a Modbus bus: health, and replies that may still come.

On a serial line a reply does not say which request it answers. After a request that went
unanswered (or whose caller was cancelled) its reply may still come, and would pass for the answer
to the next request of the same shape. So the unit is first asked something whose reply has
another shape (a *probe*). Units answer in turn: once the probe's reply is there, no older one can
come. Where no such probe exists, the unit is not asked before the last reply's time is over.
"""

from __future__ import annotations

from collections.abc import Sequence

from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.plan import Span, read_plan
from abbe.drivers.quarantine import Member

_PROBES = 8


class Unit(Member):
    """One unit's health, and replies that may still come from it.

    Parameters
    ----------
    number
        Its id on the bus.
    probes
        Reads that may serve as probes, the preferred one first.

    Attributes
    ----------
    pending
        Signature of each reply that may still come → monotonic time in s when it was asked for.
    """

    __slots__ = ("number", "pending", "probes")

    def __init__(self, number: int, probes: Sequence[Span]) -> None:
        super().__init__(f"unit {number}")
        self.number = number
        self.probes = probes
        self.pending: dict[bytes, float] = {}

    def expect_late(self, reply: bytes, now: float) -> None:
        """Remember that a reply that begins so may still come."""
        self.pending[reply] = now

    def forget_late(self, now: float, late_reply_max: float) -> None:
        """Drop replies that cannot come any more."""
        for reply, asked_at in list(self.pending.items()):
            if now - asked_at > late_reply_max:
                del self.pending[reply]

    def clear_at(self, late_reply_max: float) -> float:
        """Monotonic time in s when the last pending reply cannot come any more."""
        return max(self.pending.values(), default=0.0) + late_reply_max

    def probe(self) -> Span | None:
        """A read whose reply no pending one can be mistaken for; None when there is none."""
        return next((span for span in self.probes if span.answer not in self.pending), None)


def units_of(config: ModbusConfig) -> dict[int, Unit]:
    """All units of a link's channels, by number."""
    by_unit: dict[int, list[str]] = {}
    for name in config.channels:
        by_unit.setdefault(config.unit_of(name), []).append(name)
    return {unit: Unit(unit, _probes(config, names)) for unit, names in sorted(by_unit.items())}


def _probes(config: ModbusConfig, names: Sequence[str]) -> tuple[Span, ...]:
    """Reads with different replies: whole values first, then parts of values, shortest first."""
    gapless = config.model_copy(update={"max_gap": 0})
    runs = read_plan(gapless, names)
    whole: list[Span] = []
    parts: list[Span] = []
    for run in runs:
        span = run.span
        ends = {
            config.channels[name].address + config.channels[name].width - span.address
            for name in run.names
        }
        for count in range(1, span.count + 1):
            piece = Span(span.unit, span.table, span.address, count)
            (whole if count in ends else parts).append(piece)
    distinct: dict[bytes, Span] = {}
    for span in sorted(whole, key=lambda s: s.count) + sorted(parts, key=lambda s: s.count):
        distinct.setdefault(span.answer, span)
    return tuple(distinct.values())[:_PROBES]
