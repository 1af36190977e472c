"""Signals of effects: their excess over the reference, their lag, their rank."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
from pydantic import model_validator

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import F64, Effect, Motion, NonlinearParameter
from abbe.compcore.effects.keys import Pair, Tau
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, Signal


def per(unit: str, signal: Signal) -> str:
    """The unit of a coefficient that turns a signal into `unit`.

    >>> per("mm", Signal("T", "degC")), per("mm", Signal("F", "mm/min"))
    ('mm/K', 'mm/(mm/min)')
    """
    name = "K" if signal.temperature else signal.unit
    return f"{unit}/({name})" if "/" in name else f"{unit}/{name}"


def excess(machine: Machine, conditions: Conditions, name: str, tau: float | None) -> F64:
    """A signal's excess, shape (n,): T − T0 of a temperature, any other signal as it is.

    Behind a first-order lag of time constant `tau` (s) unless None.
    """
    value = conditions.signal(name) if tau is None else conditions.lag(name, tau)
    return value - machine.reference_temperature if machine.signals[name].temperature else value


def require_temperatures(machine: Machine, field: str, names: Iterable[str]) -> None:
    """Refuse signals that are no temperatures (degC, K), where a body is to expand by them.

    Raises
    ------
    InputError
        Of the first that is none, with the field of the effect that names it.
    """
    for name in names:
        if not machine.signals[name].temperature:
            raise InputError(
                "not a temperature",
                field=field,
                found=f"{name} in {machine.signals[name].unit}",
                expected="a signal in degC or K",
            )


def recorded(
    machine: Machine, coverage: Coverage, *, temperature: bool | None = None
) -> list[Signal]:
    """The machine's signals that a campaign recorded and that varied; temperatures, or others."""
    return [
        s
        for s in machine.signals.values()
        if s.name in coverage.signals and temperature in (None, s.temperature)
    ]


def by_sense(signals: Iterable[Signal], roles: tuple[str, ...], axis: str = "") -> list[Signal]:
    """Signals with the roles that make physical sense first, those that sit on the axis before."""
    return sorted(
        signals,
        key=lambda s: (s.role not in roles, bool(axis) and s.axis != axis),
    )


def pairs_by_sense(signals: Iterable[Signal], axis: str) -> list[tuple[Signal, Signal]]:
    """Every pair once; two sensors of one body first, then of the structure, then all others."""

    def rank(pair: tuple[Signal, Signal]) -> tuple[bool, bool, bool]:
        one, two = pair
        structure = one.role == two.role == "structure"
        return (not structure, one.axis != two.axis, axis not in (one.axis, two.axis))

    return sorted(combinations(signals, 2), key=rank)


_LENGTHS = ("mm", "um", "µm", "nm", "m")
_ANGLES = ("deg", "rad", "mrad", "urad", "µrad", "arcsec")
_WEIGHTS = ("kg", "t", "N", "kN", "Nm")
_PRESSURES = ("bar", "mbar", "Pa", "hPa", "kPa", "MPa")
_NO_HEAT = frozenset({*_LENGTHS, *_ANGLES, *_WEIGHTS, *_PRESSURES, "s"})
"""Units of what warms nothing: lengths, angles, times, weights, forces, pressures."""


def heats(signal: Signal) -> bool:
    """Whether a body may warm by a signal: a temperature, a speed, a current, a power, a valve."""
    return signal.temperature or signal.unit not in _NO_HEAT


ACTING = ("load", "speed", "coolant", "other")
"""Roles of signals that are no temperatures, and by which a body warms or bends all the same."""

LAGGING = ("ambient", "coolant", "spindle", "speed", "load", "screw", "other")
"""Roles of signals that a body follows late: they are not measured on that body itself."""


def lag_parameter(duration: float = 20_000.0, interval: float = 0.0) -> NonlinearParameter:
    """The time constant of a first-order lag (s), to be fitted.

    `duration`: how long the campaign ran without a night, s. A lag much longer than that looks
    like a drift.
    `interval`: time from reading to reading, s. One that is shorter looks like none; beside the
    signal itself it would be its derivative.
    """
    longest = max(3.0 * duration, 600.0, 4.0 * interval)
    shortest = max(5.0, interval)
    starts, tau = [], max(30.0, shortest)
    while tau < longest:
        starts.append(tau)
        tau *= 1.8
    return NonlinearParameter(
        "tau",
        "s",
        bounds=(shortest, longest),
        starts=tuple(starts),
        plausible=(30.0, 5e4),
        description="time constant of the body that follows the signal",
    )


class LaggedEffect(Effect):
    """An effect whose signals may stand behind a first-order lag.

    ``tau`` absent: the signals as they are; a number: that time constant (s); ``fit``: fitted.
    """

    tau: Tau = None

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """The time constant where it is to be fitted."""
        return (lag_parameter(),) if self.tau == "fit" else ()

    def search(self, machine: Machine, coverage: Coverage) -> tuple[NonlinearParameter, ...]:
        """Time constants that the campaign is long enough to show."""
        if self.tau != "fit":
            return ()
        if coverage.stretch <= 0.0:
            return (lag_parameter(),)
        return (lag_parameter(coverage.stretch, coverage.interval),)

    def lag(self, nonlinear: Mapping[str, float]) -> float | None:
        """The time constant in force, s; None for no lag."""
        return nonlinear["tau"] if self.tau == "fit" else self.tau

    def lags(self, nonlinear: Mapping[str, float]) -> tuple[float, ...]:
        """The time constants of all bodies, s; empty without a lag."""
        tau = self.lag(nonlinear)
        return () if tau is None else (tau,)

    @property
    def settles(self) -> bool:
        """Whether there is a lag."""
        return self.tau is not None

    def warmed(self) -> tuple[str, ...]:
        """The signals that stand for one body: of a difference the first alone."""
        return self.signals_needed()[:1]

    def settling(
        self,
        machine: Machine,
        conditions: Conditions,
        nonlinear: Mapping[str, float],
        since: F64,
    ) -> tuple[Motion, ...]:
        """The motions with ``e^(−t/τ)`` in place of the lagged excess."""
        signals, lags = dict(conditions.signals), {}
        for name in self.signals_needed():
            rest = machine.reference_temperature if machine.signals[name].temperature else 0.0
            signals[name] = np.full(conditions.n, rest)
            for tau in self.lags(nonlinear):
                above = np.exp(-since / tau) if name in self.warmed() else 0.0
                lags[name, tau] = signals[name] + above
        decaying = replace(
            conditions, signals=signals, given_lags=lags, _lags={}, _known=None, _made={}
        )
        return self.motions(machine, decaying, nonlinear)


class OneOrTwoSignals(LaggedEffect):
    """An effect by the excess of one signal, or by the difference of two (``signals``)."""

    signal: str | None = None
    signals: Pair | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_of_a_list(cls, keys: object) -> object:
        if isinstance(keys, dict) and keys.get("signal") is None:
            names = keys.get("signals")
            names = names.split(",") if isinstance(names, str) else names
            if isinstance(names, list | tuple) and len(names) == 1:
                rest = {k: v for k, v in keys.items() if k != "signals"}
                return {**rest, "signal": names[0]}
        return keys

    @model_validator(mode="after")
    def _one_or_two(self) -> OneOrTwoSignals:
        if (self.signal is None) == (self.signals is None):
            raise InputError(
                f"{self.kind} needs one signal or two signals, not both",
                expected="signal=T or signals=T1,T2",
            )
        return self

    def check(self, machine: Machine) -> None:
        """Known signals; two are different and of one unit."""
        super().check(machine)
        if self.signals is not None:
            two_alike(machine, self.signals)

    def heat(self, machine: Machine, conditions: Conditions, tau: float | None) -> F64:
        """``T − T0`` of the one signal, ``T1 − T2`` of two, shape (n,)."""
        parts = [excess(machine, conditions, s, tau) for s in self.signals_needed()]
        return parts[0] if self.signal is not None else parts[0] - parts[1]


def two_alike(machine: Machine, names: tuple[str, str]) -> None:
    """Refuse a difference of a signal with itself, or of two units.

    Raises
    ------
    InputError
        Naming both.
    """
    units = [machine.signals[name].unit for name in names]
    if names[0] == names[1] or units[0] != units[1]:
        raise InputError(
            "the difference needs two signals of one unit",
            field="signals",
            found=", ".join(f"{n} in {u}" for n, u in zip(names, units, strict=True)),
        )
