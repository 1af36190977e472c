"""Conditions on which effects are evaluated: positions, directions and signals, row by row."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.lag import Clock
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
T = TypeVar("T")

_MOST_LAGGED = 4_000_000
"""Lagged values that are kept at the most: 32 MB."""


@dataclass(frozen=True, eq=False)
class SetupRows:
    """Which rows of a table of conditions belong to which set-up of the instrument.

    Attributes
    ----------
    index
        Name → number of the set-up.
    number
        Each row's set-up, shape (n,).
    first
        Each set-up's earliest row, shape (number of set-ups,).
    """

    index: Mapping[str, int]
    number: NDArray[np.int64]
    first: NDArray[np.int64]

    def mask(self, name: str) -> NDArray[np.bool_]:
        """The rows of one set-up, shape (n,); none where it does not occur."""
        return np.equal(self.number, self.index.get(name, -1))

    def since_start(self, values: F64) -> F64:
        """Values, (n,) or (n, 3), less what they were at the start of the row's own set-up."""
        return np.asarray(values - values[self.first][self.number])


@dataclass(frozen=True, eq=False)
class _KnownLags:
    """Lagged values of conditions from which others were made; what is not asked for is not made.

    A search leaves thousands of them behind, of which an amended reading needs one.

    Attributes
    ----------
    of, before
        (signal, τ) → shape (n,), and what those conditions knew of others in their turn.
    name, amended
        The signal that was amended since, and how; None: none was.
    index
        The rows that were taken since; None: all.
    """

    of: Mapping[tuple[str, float], F64]
    before: _KnownLags | None
    name: str = ""
    amended: Callable[[F64], F64] | None = None
    index: slice | NDArray[np.int64] | NDArray[np.bool_] | None = None

    def get(self, key: tuple[str, float]) -> F64 | None:
        """A lagged signal, (n,); None where it is not known."""
        value = self.of.get(key)
        if value is None and self.before is not None:
            value = self.before.get(key)
        if value is None:
            return None
        if self.amended is not None and key[0] == self.name:
            value = self.amended(value)
        return value if self.index is None else value[self.index]


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions of n measurements or predictions: indicated positions, directions, signals, tool.

    A number, or an array of one value, stands for all rows: one temperature beside many positions.

    Attributes
    ----------
    positions
        Axis → indicated positions, shape (n,), mm (rotary: rad).
    directions
        Axis → approach direction, shape (n,): 1, −1, or 0 for not moved or unknown.
    tool
        Tool or probe offset, shape (n, 3), mm.
    time
        Shape (n,), s since the campaign's (or the daemon's) start.
    signals
        Name → shape (n,), in the signal's own unit.
    spindle_angle
        Angle of a spindle in brackets, shape (n,), rad; the tool's offset turns with it.
    run
        Shape (n,): rows of different runs (campaigns) have separate clocks. None: one run.
    stretch
        Shape (n,): rows between which no night without readings lies share a number
        (`stretches_between_nights`); bodies begin each anew. None: a stretch is a run.
    setup, u
        For effects of the instrument: set-up name of each row, shape (n,), and the unit vector
        of the measured component in machine axes, shape (n, 3). None outside campaigns.
    base
        For distances: name of each row's base point, shape (n,), empty where there is none.
    kind, distance
        For effects of the instrument: what each row measures
        (`abbe.compcore.campaign.campaign.Kind`), shape
        (n,), and the measured length of distances, shape (n,), mm, 0 on other rows. None outside
        campaigns.
    given_lags
        (signal, τ) → shape (n,): lagged values that the live path has kept; else computed here.
    """

    positions: Mapping[str, F64]
    directions: Mapping[str, F64] = field(default_factory=dict)
    tool: F64 = field(default_factory=lambda: np.zeros((0, 3)))
    time: F64 = field(default_factory=lambda: np.zeros(0))
    signals: Mapping[str, F64] = field(default_factory=dict)
    spindle_angle: F64 | None = None
    run: NDArray[np.int64] | None = None
    stretch: NDArray[np.int64] | None = None
    setup: NDArray[np.str_] | None = None
    u: F64 | None = None
    base: NDArray[np.str_] | None = None
    kind: NDArray[np.int8] | None = None
    distance: F64 | None = None
    given_lags: Mapping[tuple[str, float], F64] = field(default_factory=dict)
    _lags: dict[tuple[str, float], F64] = field(default_factory=dict, repr=False)
    _known: _KnownLags | None = field(default=None, repr=False)
    _made: dict[Hashable, tuple[F64, F64]] = field(default_factory=dict, repr=False)
    _setups: tuple[NDArray[np.str_], F64, SetupRows] | None = field(default=None, repr=False)
    _straightened: Mapping[str, tuple[F64, Callable[[F64], F64]]] = field(
        default_factory=dict, repr=False
    )

    def __post_init__(self) -> None:
        columns = (*self.positions.values(), *self.directions.values(), *self.signals.values())
        if not all(isinstance(v, np.ndarray) and v.ndim for v in (*columns, self.time)) or (
            len({len(v) for v in columns}) > 1 or np.ndim(self.tool) != 2
        ):
            self._broadcast()
        n = len(next(iter(self.positions.values()))) if self.positions else len(self.time)
        object.__setattr__(self, "n", n)
        if not self.tool.size and self.tool.shape[0] != n:
            object.__setattr__(self, "tool", np.zeros((n, 3)))
        if self.time.shape[0] != n and not self.time.size:
            object.__setattr__(self, "time", np.zeros(n))
        shapes = {
            **{f"position {k}": v.shape for k, v in self.positions.items()},
            **{f"direction {k}": v.shape for k, v in self.directions.items()},
            **{f"signal {k}": v.shape for k, v in self.signals.items()},
            "time": self.time.shape,
        }
        for name, shape in shapes.items():
            if shape != (n,):
                raise ValueError(f"{name} has shape {shape}, expected {(n,)}")
        if self.tool.shape != (n, 3):
            raise ValueError(f"tool has shape {self.tool.shape}, expected {(n, 3)}")

    n: int = field(init=False, default=0)
    _kept: dict[Hashable, Any] = field(init=False, default_factory=dict, repr=False)

    def _broadcast(self) -> None:
        """Numbers, lists and arrays of one value become as long as the others."""
        tables: dict[str, dict[str, F64]] = {
            name: {k: np.atleast_1d(np.asarray(v, dtype=np.float64)) for k, v in table.items()}
            for name in ("positions", "directions", "signals")
            for table in (getattr(self, name),)
        }
        time = np.atleast_1d(np.asarray(self.time, dtype=np.float64))
        tool = np.asarray(self.tool, dtype=np.float64)
        lengths = [len(v) for table in tables.values() for v in table.values()]
        lengths += [len(time)] * bool(time.size) + [len(tool)] * (tool.ndim == 2 and tool.size > 0)
        n = next((length for length in lengths if length != 1), 1)
        for name, table in tables.items():
            # one of another length than the others is named by the check that follows
            fitting = {k: np.broadcast_to(v, n) if len(v) == 1 else v for k, v in table.items()}
            object.__setattr__(self, name, fitting)
        object.__setattr__(self, "time", np.broadcast_to(time, n) if len(time) == 1 else time)
        if tool.shape in ((3,), (1, 3)):
            tool = np.broadcast_to(tool, (n, 3))
        object.__setattr__(self, "tool", tool)

    @classmethod
    def at(
        cls,
        positions: Mapping[str, ArrayLike],
        *,
        tool: ArrayLike = (0.0, 0.0, 0.0),
        directions: Mapping[str, ArrayLike] | None = None,
        time: ArrayLike = 0.0,
        signals: Mapping[str, ArrayLike] | None = None,
    ) -> Conditions:
        """Conditions from scalars and arrays that broadcast to one length.

        Positions in mm (rotary: rad), tool in mm (shape (3,) or (n, 3)), time in s, signals in
        their own units.
        """
        directions = directions or {}
        signals = signals or {}
        scalars = [*positions.values(), *directions.values(), *signals.values(), time]
        tool_rows = np.atleast_2d(np.asarray(tool, dtype=np.float64))
        (n,) = np.broadcast_shapes((tool_rows.shape[0],), *(np.shape(s) for s in scalars))

        def column(value: ArrayLike) -> F64:
            return np.broadcast_to(np.asarray(value, dtype=np.float64), (n,))

        return cls(
            positions={k: column(v) for k, v in positions.items()},
            directions={k: column(v) for k, v in directions.items()},
            tool=np.broadcast_to(tool_rows, (n, 3)),
            time=column(time),
            signals={k: column(v) for k, v in signals.items()},
        )

    def position(self, axis: str) -> F64:
        """Indicated positions of an axis, shape (n,), mm (rotary: rad).

        Raises
        ------
        InputError
            When none were recorded.
        """
        try:
            return self.positions[axis]
        except KeyError:
            raise InputError(f"no positions of axis {axis} were recorded", field=axis) from None

    def direction(self, axis: str) -> F64:
        """Approach directions of an axis, shape (n,): 1, −1; 0 where not recorded."""
        found = self.directions.get(axis)
        return np.zeros(self.n) if found is None else found

    def signal(self, name: str) -> F64:
        """A recorded signal, shape (n,), in its own unit.

        Raises
        ------
        InputError
            When it was not recorded; lists those that were.
        """
        try:
            return self.signals[name]
        except KeyError:
            raise InputError(
                "an effect needs a signal that was not recorded",
                field=name,
                expected="one of " + (", ".join(sorted(self.signals)) or "none recorded"),
            ) from None

    def lag(self, name: str, tau: float) -> F64:
        """A signal behind a first-order lag of time constant `tau` (s), shape (n,).

        Equilibrium with its first sample at the start of each stretch (`lag`). In a run without a
        clock, all of it at one time, every row is in equilibrium with its own sample.
        """
        key = (name, tau)
        if key in self.given_lags:
            return self.given_lags[key]
        if key not in self._lags:
            known = None if self._known is None else self._known.get(key)
            lagged = self._lagged(name, tau) if known is None else known
            # a search tries thousands of time constants
            while len(self._lags) * self.n > _MOST_LAGGED:
                del self._lags[next(iter(self._lags))]
            self._lags[key] = lagged
        return self._lags[key]

    def _lagged(self, name: str, tau: float) -> F64:
        # of what is no straight line of the reading the lagged reading is straightened
        value, amended = self._straightened.get(name, (self.signal(name), np.asarray))
        lagged = np.array(value, dtype=np.float64)
        for rows, clock in self._clocks:
            lagged[rows] = clock.lag(value[rows], tau)
        straight: F64 = amended(lagged)
        return straight

    @property
    def stretches(self) -> NDArray[np.int64]:
        """The number of each row's stretch (`stretch`), or run, (n,)."""
        if self.stretch is not None:
            return self.stretch
        return np.zeros(self.n, dtype=np.int64) if self.run is None else self.run

    @cached_property
    def _clocks(self) -> list[tuple[NDArray[np.int64], Clock]]:
        """The rows of each stretch in which time goes on, and their clock."""
        stretches = self.stretches
        found = (np.flatnonzero(stretches == one) for one in np.unique(stretches))
        return [(rows, Clock.of(self.time[rows])) for rows in found if np.ptp(self.time[rows]) > 0]

    def cached(self, key: Hashable, source: F64, make: Callable[[], F64]) -> F64:
        """An array computed from `source` by `make`, kept as long as `source` is the same array.

        Six error motions of one axis share their basis functions. The result is read-only.
        """
        kept = self._made.get(key)
        if kept is None or kept[0] is not source:
            made = make()
            made.flags.writeable = False
            kept = (source, made)
            self._made[key] = kept
        return kept[1]

    def kept(self, key: Hashable, make: Callable[[], T]) -> T:
        """What `make` works out of these rows, kept as long as they are."""
        if key not in self._kept:
            self._kept[key] = make()
        found: T = self._kept[key]
        return found

    def lags_computed(self) -> tuple[tuple[str, float], ...]:
        """(signal, τ in s) of every lag that has been asked for and was computed here."""
        return tuple(self._lags)

    def mean_signal(self, names: tuple[str, ...], tau: float | None = None) -> F64:
        """Mean of one or more signals, each lagged by `tau` (s) unless None, shape (n,)."""
        total = np.zeros(self.n)
        for name in names:
            total = total + (self.signal(name) if tau is None else self.lag(name, tau))
        return total / len(names)

    def with_offset(self, name: str, offset: float) -> Conditions:
        """The same conditions with a signal, and its lags, higher by `offset` (signal's unit).

        A signal that was not recorded stays so.
        """
        return self._with_reading(name, lambda v: v + offset)

    def with_gain(self, name: str, factor: float, about: float) -> Conditions:
        """The same conditions with a signal, and its lags, `factor` times as far from a value.

        `about`: the value that stays, in the signal's unit. A signal that was not recorded stays
        so.
        """
        return self._with_reading(name, lambda v: about + factor * (v - about))

    def straightened(self, name: str, bend: float, about: float, *, now: float = 0.0) -> Conditions:
        """The same conditions with a signal that reads `bend·(v − about)²` too much put right.

        Parameters
        ----------
        bend
            In 1 by the signal's unit. Lags of the signal are straightened as they are.
        about
            Where it reads right, in the signal's unit.
        now
            With which bend the signal was straightened already.
        """

        def amended(v: F64) -> F64:
            off = v - about
            off = off + now * off**2
            return np.asarray(
                about + 2.0 * off / (1.0 + np.sqrt(np.maximum(1.0 + 4.0 * bend * off, 0.0)))
            )

        if name not in self.signals:
            return self
        if name in self._straightened:
            return self._with_reading(name, amended)
        read = (self.signals[name], np.asarray)
        before = replace(self, _straightened={**self._straightened, name: read})
        return before._with_reading(name, amended)

    def _with_reading(self, name: str, amended: Callable[[F64], F64]) -> Conditions:
        """A signal and its lags amended: by a straight line of the reading, or a known curve."""
        given = {k: amended(v) if k[0] == name else v for k, v in self.given_lags.items()}
        curved = dict(self._straightened)
        if name in curved:
            read, known = curved[name]
            curved[name] = read, lambda v: amended(known(v))
        return replace(
            self,
            signals={k: amended(v) if k == name else v for k, v in self.signals.items()},
            given_lags=given,
            _lags={},
            _known=_KnownLags(dict(self._lags), self._known, name, amended),
            _straightened=curved,
        )

    def setup_rows(self) -> SetupRows:
        """Which rows belong to which set-up.

        Raises
        ------
        InputError
            When the conditions are not those of a campaign.
        """
        if self.setup is None:
            raise InputError("an effect of the instrument needs a campaign's set-ups")
        kept = self._setups
        if kept is not None and kept[0] is self.setup and kept[1] is self.time:
            return kept[2]
        names, inverse = np.unique(self.setup, return_inverse=True)
        number = inverse.reshape(-1)
        # of each set-up's rows the earliest, and of rows of one time the one that stands first
        order = np.lexsort((np.arange(self.n), self.time))[::-1]
        first = np.zeros(len(names), dtype=np.int64)
        first[number[order]] = order
        found = SetupRows({str(name): i for i, name in enumerate(names)}, number, first)
        object.__setattr__(self, "_setups", (self.setup, self.time, found))
        return found

    def rows(self, index: slice | NDArray[np.int64] | NDArray[np.bool_]) -> Conditions:
        """Some of the rows; lags already computed on the whole table are kept."""

        def pick(table: Mapping[str, F64]) -> dict[str, F64]:
            return {k: v[index] for k, v in table.items()}

        return replace(
            self,
            positions=pick(self.positions),
            directions=pick(self.directions),
            tool=self.tool[index],
            time=self.time[index],
            signals=pick(self.signals),
            spindle_angle=None if self.spindle_angle is None else self.spindle_angle[index],
            run=None if self.run is None else self.run[index],
            stretch=None if self.stretch is None else self.stretch[index],
            setup=None if self.setup is None else self.setup[index],
            u=None if self.u is None else self.u[index],
            base=None if self.base is None else self.base[index],
            kind=None if self.kind is None else self.kind[index],
            distance=None if self.distance is None else self.distance[index],
            given_lags={k: v[index] for k, v in self.given_lags.items()},
            _lags={},
            _known=_KnownLags(dict(self._lags), self._known, index=index),
            _made={},
            _setups=None,
            _straightened={k: (v[index], by) for k, (v, by) in self._straightened.items()},
        )

    def moved(self, offset: Mapping[str, F64]) -> Conditions:
        """The same conditions with some axes displaced, shape (n,) each, mm (rotary: rad)."""
        return replace(
            self,
            positions={k: v + offset[k] if k in offset else v for k, v in self.positions.items()},
        )


def unit_of(axis: str) -> str:
    """The unit of an axis's positions inside the code.

    >>> unit_of("X"), unit_of("C")
    ('mm', 'rad')
    """
    return "rad" if is_rotary(axis) else "mm"
