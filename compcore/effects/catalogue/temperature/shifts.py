"""Thermal shifts: what moves the functional point by a temperature, or by a difference of two."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import model_validator

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    FUNCTIONAL_POINT,
    SPINDLE,
    AxisLetter,
    ErrorMotion,
    Motion,
    NonlinearParameter,
    Parameter,
)
from abbe.compcore.effects.keys import Tau
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import (
    OneOrTwoSignals,
    by_sense,
    heats,
    lag_parameter,
    pairs_by_sense,
    per,
    recorded,
)
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.typical import typical


@register
class ThermalOffset(OneOrTwoSignals):
    """A shift that follows a temperature: spindle growth, a zero that wanders (ISO 230-3).

    Formula
        ``d = k·(T − T0)`` at the functional point, optionally with T behind a first-order lag τ;
        for a signal that is no temperature (speed, load) ``d = k·signal``; for two ``signals``
        ``d = k·(T1 − T2)``, a body's rise above another or above the air. Where two bodies follow
        one signal, bearing and head, ``tau2`` beside ``tau`` adds ``k2`` times the signal behind
        that second lag. With ``start = fit`` beside a lag each run, that is each file, adds
        ``c·e^(−t/τ)`` for each body, t in s since it began: the body was warmer or colder then
        than its signal says. Like a set-up's zero c belongs to that run: it is fitted wherever the
        run is fitted or compared, and is no parameter. The direction is one of
        the machine's; where the (first) signal's role is ``spindle`` and rotary axes turn the head,
        it turns with the spindle.
    Parameters
    ----------
        k in mm/K, within ±20 µm/K: a steel spindle nose 200 mm in front of its fixed bearing grows
        by 2.3 µm/K, a column of 1 m by 11 µm/K (per rpm and the like: ±0.2 mm over the signal's
        common range); k2 likewise.
    Signals
        One; the temperature of the body that grows, or one that it follows (lag): spindle bearing,
        coolant, ambient, or the spindle's speed with a lag of 10 to 60 minutes. Or two
        temperatures, where what is bolted to a body moves by how much warmer that is than what
        carries it.
    Typical causes
        Heat of spindle bearings and motor, head and column that grow, a probe or reference point
        whose mounting warms, coolant.
    Cure
        Spindle cooling, a symmetric head, touching a reference point often; live compensation.
    Source
        ISO 230-3 (thermal distortion by rotating spindle and by linear motion; ETVE); Mayr et al.,
        CIRP Annals 61/2 (2012), 771-791.
    """

    kind = "thermal_offset"
    of_a_run = ("start",)
    direction: AxisLetter
    tau2: Tau = None
    start: Literal["fit"] | None = None

    @model_validator(mode="after")
    def _beside_a_lag(self) -> ThermalOffset:
        for key in ("tau2", "start"):
            value = getattr(self, key)
            if value is not None and self.tau is None:
                raise InputError(
                    "a second lag, or a state at the start, stands beside a first lag",
                    field=key,
                    found=value,
                    expected="a tau beside it: tau=fit",
                )
        return self

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """The time constants where they are to be fitted."""
        return self._both(super().nonlinear(machine), machine)

    def search(self, machine: Machine, coverage: Coverage) -> tuple[NonlinearParameter, ...]:
        """Time constants that the campaign is long enough to show, and fine enough."""
        return self._both(super().search(machine, coverage), machine)

    def _both(
        self, first: tuple[NonlinearParameter, ...], machine: Machine
    ) -> tuple[NonlinearParameter, ...]:
        if self.tau2 != "fit":
            return first
        (like,) = first or (lag_parameter(),)
        # two are searched together: on a coarser grid
        like = replace(like, starts=like.starts[::2])
        second = replace(like, name="tau2", description="that of a second body")
        return (like, second) if first else (second,)

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The shift by temperature; that of a second body."""
        names = self.signals_needed()
        signal = machine.signals[names[0]]
        most = 0.2 / typical(signal).change
        text = f"shift in {self.direction} by {' − '.join(names)}"
        found = (Parameter("k", per("mm", signal), (-most, most), text),)
        if self.tau2 is None:
            return found
        text = f"shift in {self.direction} of a second body"
        return (*found, Parameter("k2", per("mm", signal), (-most, most), text))

    def lags(self, nonlinear: Mapping[str, float]) -> tuple[float, ...]:
        """The time constants of both bodies, s."""
        first = super().lags(nonlinear)
        if self.tau2 is None:
            return first
        return (*first, nonlinear["tau2"] if self.tau2 == "fit" else self.tau2)

    @property
    def began_anywhere(self) -> bool:
        """Whether each run finds the bodies where they are."""
        return self.start is not None

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``T − T0`` on the shift, for each body behind its own lag."""
        lags = self.lags(nonlinear) or (None,)
        columns = [self.heat(machine, conditions, tau) for tau in lags]
        (body, *_) = self.signals_needed()
        place = SPINDLE if machine.signals[body].role == "spindle" else FUNCTIONAL_POINT
        return (Motion(ErrorMotion(place, self.direction), np.stack(columns, axis=1)),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[ThermalOffset]:
        """Three directions with each signal: spindle and structure first, Z first; then lagged.

        Then with each difference of two temperatures, as it is; a scale's own says where the scale
        is.
        """
        warm = filter(heats, recorded(machine, coverage))
        signals = by_sense(warm, ("spindle", "structure", "speed"))
        for tau in (None, "fit"):
            for signal in signals:
                for direction in ("Z", "X", "Y"):
                    yield cls(direction=direction, signal=signal.name, tau=tau)
        bodies = [s for s in recorded(machine, coverage, temperature=True) if s.role != "scale"]
        for one, other in pairs_by_sense(bodies, ""):
            for direction in ("Z", "X", "Y"):
                yield cls(direction=direction, signals=(one.name, other.name))
