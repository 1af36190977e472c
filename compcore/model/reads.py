"""Inputs of an effect, found by evaluating it on conditions that record every access.

An effect says which positions and directions it uses, but not whether it looks at the clock, the
tool or a lagged signal. Noting what it really reads covers all of these, and effects of plugin
packages that declare too little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]


@dataclass
class Reads:
    """The recorded conditions that an evaluation has accessed.

    Attributes
    ----------
    positions, directions, signals
        Names of axes and signals.
    lags
        (signal, time constant in s).
    others
        Of ``time``, ``tool`` and ``spindle_angle`` those that were read.
    """

    positions: set[str] = field(default_factory=set)
    directions: set[str] = field(default_factory=set)
    signals: set[str] = field(default_factory=set)
    lags: set[tuple[str, float]] = field(default_factory=set)
    others: set[str] = field(default_factory=set)

    @property
    def slow(self) -> bool:
        """Whether anything but positions and directions was accessed."""
        return bool(self.signals or self.lags or self.others)


class _Noting(Mapping[str, F64]):
    """A mapping that notes which of its keys are looked up."""

    def __init__(self, values: Mapping[str, F64], noted: set[str]) -> None:
        self._values = values
        self._noted = noted

    def __getitem__(self, key: str) -> F64:
        value = self._values[key]
        self._noted.add(key)
        return value

    def unnoted(self, key: str) -> F64:
        """A value looked up without a note."""
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: object) -> bool:
        return key in self._values


@dataclass(frozen=True, eq=False)
class _Watched(Conditions):
    """Conditions that note what is read of them; a lagged signal is the signal itself."""

    reads: Reads = field(default_factory=Reads)

    def __getattribute__(self, name: str) -> object:
        if name in ("time", "tool", "spindle_angle"):
            object.__getattribute__(self, "reads").others.add(name)
        return object.__getattribute__(self, name)

    def lag(self, name: str, tau: float) -> F64:
        self.reads.lags.add((name, tau))
        signals = self.signals
        # the signal itself is not noted: only what stays behind it counts
        return signals.unnoted(name) if isinstance(signals, _Noting) else signals[name]


def reads_of(evaluate: Callable[[Conditions], object], conditions: Conditions) -> Reads:
    """The inputs that `evaluate` accesses of some conditions; a lag is the signal itself."""
    reads = Reads()
    watched = _Watched(
        positions=_Noting(conditions.positions, reads.positions),
        directions=_Noting(conditions.directions, reads.directions),
        tool=conditions.tool,
        time=conditions.time,
        signals=_Noting(conditions.signals, reads.signals),
        spindle_angle=conditions.spindle_angle,
        reads=reads,
    )
    for noted in (reads.positions, reads.directions, reads.signals, reads.lags, reads.others):
        noted.clear()
    evaluate(watched)
    return reads
