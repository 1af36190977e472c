"""Inputs of an effect, found by evaluating it on conditions that record every access.

An effect says which positions and directions it uses, but not whether it looks at the clock, the
tool or a lagged signal. Noting what it really reads covers all of these, and effects of plugin
packages that declare too little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

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

    def noted(self) -> tuple[set[str], ...]:
        """The sets of names, which grow as conditions are read; lags are not among them."""
        return self.positions, self.directions, self.signals, self.others


class _Noting(Mapping[str, F64]):
    """A mapping that notes which of its keys are looked up."""

    def __init__(self, values: Mapping[str, F64], noted: set[str]) -> None:
        self._values = values
        self._noted = noted

    def __getitem__(self, key: str) -> F64:
        value = self._values[key]
        self._noted.add(key)
        return value

    @property
    def unnoted(self) -> Mapping[str, F64]:
        """The values, of which no look-up is noted."""
        return self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: object) -> bool:
        return key in self._values


@dataclass(frozen=True, eq=False)
class _Watched(Conditions):
    """Conditions that note what is read of them; a lagged signal is the signal itself.

    To copy is not to read: amended, displaced and picked conditions note what is read of *them*.
    """

    reads: Reads = field(default_factory=Reads)

    @classmethod
    def noting(cls, conditions: Conditions, reads: Reads) -> _Watched:
        """The same conditions, watched."""
        own = _columns(conditions)
        for name, noted in zip(("positions", "directions", "signals"), reads.noted(), strict=False):
            own[name] = _Noting(own[name], noted)
        return cls(**own, reads=reads)

    def __post_init__(self) -> None:
        before = [(noted, set(noted)) for noted in self.reads.noted()]
        super().__post_init__()
        for noted, names in before:  # to check columns is not to read them
            noted &= names

    def __getattribute__(self, name: str) -> object:
        if name in ("time", "tool", "spindle_angle"):
            object.__getattribute__(self, "reads").others.add(name)
        return object.__getattribute__(self, name)

    def lag(self, name: str, tau: float) -> F64:
        self.reads.lags.add((name, tau))
        # the signal itself is not noted: only what stays behind it counts
        return _unnoted(self.signals)[name]

    def straightened(self, name: str, bend: float, about: float, *, now: float = 0.0) -> Conditions:
        return self._watching(self._bare().straightened(name, bend, about, now=now))

    def _with_reading(self, name: str, amended: Callable[[F64], F64]) -> Conditions:
        return self._watching(self._bare()._with_reading(name, amended))

    def rows(self, index: slice | NDArray[np.int64] | NDArray[np.bool_]) -> Conditions:
        return self._watching(self._bare().rows(index))

    def moved(self, offset: Mapping[str, F64]) -> Conditions:
        return self._watching(self._bare().moved(offset))

    def _watching(self, conditions: Conditions) -> Conditions:
        return _Watched.noting(conditions, self.reads)

    def _bare(self) -> Conditions:
        return Conditions(**_columns(self))


def _columns(conditions: Conditions) -> dict[str, Any]:
    """What conditions are made of, field by field, without a note."""
    found = {}
    for one in fields(Conditions):
        if one.init:
            value = object.__getattribute__(conditions, one.name)
            found[one.name] = _unnoted(value) if isinstance(value, _Noting) else value
    return found


def _unnoted(values: Mapping[str, F64]) -> Mapping[str, F64]:
    return values.unnoted if isinstance(values, _Noting) else values


def reads_of(evaluate: Callable[[Conditions], object], conditions: Conditions) -> Reads:
    """The inputs that `evaluate` accesses of some conditions; a lag is the signal itself."""
    reads = Reads()
    evaluate(_Watched.noting(conditions, reads))
    return reads
