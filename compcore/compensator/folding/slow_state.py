"""The slow state: what changes at a few hertz while the machine moves at its own pace."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, Signal
from abbe.compcore.machine.typical import typical_range
from abbe.compcore.model.reads import Reads

F64 = NDArray[np.float64]
Vec3 = tuple[float, float, float]

_MOST = 8
"""Walsh patterns, at most."""


@dataclass(frozen=True)
class SlowState:
    """Everything but positions and directions.

    Attributes
    ----------
    time
        s, on the daemon's clock.
    signals
        Name → value in the signal's own unit.
    lags
        (signal, time constant in s) → lagged value, the signal's unit.
    tool
        Tool or probe offset, mm.
    spindle_angle
        Angle of the spindle in brackets, rad; None: the tool's offset does not turn.
    """

    time: float = 0.0
    signals: Mapping[str, float] = field(default_factory=dict)
    lags: Mapping[tuple[str, float], float] = field(default_factory=dict)
    tool: Vec3 = (0.0, 0.0, 0.0)
    spindle_angle: float | None = None

    def seen_by(self, reads: Reads) -> tuple[object, ...]:
        """Those parts that an effect reads, to be compared with what it has seen before."""
        return (
            *map(self.signals.get, reads.signals),
            *map(self.lags.get, reads.lags),
            *(getattr(self, name) for name in reads.others),
        )

    def conditions(self, positions: Mapping[str, F64], directions: Mapping[str, F64]) -> Conditions:
        """This state at n rows of positions (mm or rad) and directions, each of shape (n,)."""
        n = next(iter(positions.values())).shape[0]
        spindle = self.spindle_angle
        return Conditions(
            positions=positions,
            directions=directions,
            tool=np.full((n, 3), self.tool),
            time=np.full(n, self.time),
            signals={name: np.full(n, value) for name, value in self.signals.items()},
            spindle_angle=None if spindle is None else np.full(n, spindle),
            given_lags={key: np.full(n, value) for key, value in self.lags.items()},
        )


def reference_state(machine: Machine, signals: Iterable[str]) -> SlowState:
    """All temperatures a little above the reference, every other signal in mid-range."""
    values = {name: float(np.mean(_span(machine, name, ()))) + 1.0 for name in signals}
    return SlowState(signals=values)


def plausible_states(
    machine: Machine,
    signals: Iterable[str],
    lags: Iterable[tuple[str, float]],
    present: SlowState,
    *,
    seen: bool,
) -> list[SlowState]:
    """States at the ends of what the signals may do, for laying out tables.

    Walsh patterns of highs and lows: of any two signals, some state has both high and some state
    has one high and one low, so that a difference of temperatures shows as well as their sum.

    Parameters
    ----------
    present
        Tool and spindle of all states.
    seen
        Whether the present state's signals occurred: then the ranges reach at least to them, and
        it is one of the states.
    """
    keys: list[str | tuple[str, float]] = [*signals, *lags]
    states_seen = (present,) if seen else ()
    spans = [_span(machine, key, states_seen) for key in keys]
    count = min(_MOST, 2 ** math.ceil(math.log2(len(keys) + 1))) if keys else 1
    states = []
    for i in range(count):
        ends = [
            span[(i & (j % (count - 1) + 1)).bit_count() % 2] if count > 1 else span[1]
            for j, span in enumerate(spans)
        ]
        chosen = dict(zip(keys, ends, strict=True))
        states.append(
            SlowState(
                time=3600.0 * i * i,
                signals={k: v for k, v in chosen.items() if isinstance(k, str)},
                lags={k: v for k, v in chosen.items() if isinstance(k, tuple)},
                tool=present.tool,
                spindle_angle=present.spindle_angle,
            )
        )
    return [*states, *states_seen]


def _span(
    machine: Machine, key: str | tuple[str, float], seen: tuple[SlowState, ...]
) -> tuple[float, float]:
    signal = machine.signals.get(key if isinstance(key, str) else key[0], Signal(""))
    low, high = typical_range(signal, machine)
    values = [s.signals[key] if isinstance(key, str) else s.lags[key] for s in seen]
    return min([low, *values]), max([high, *values])
