"""Thermal effects: expansion, offsets and heating, by temperatures and lags behind them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    Motion,
    Parameter,
)
from abbe.compcore.effects.keys import Finite, Names
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import (
    LaggedEffect,
    by_sense,
    excess,
    heats,
    per,
    recorded,
    require_temperatures,
)
from abbe.compcore.effects.targets import along, require_linear
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.typical import typical


@register
class ScaleExpansion(LaggedEffect):
    """Thermal expansion of a scale: the axis's own scale factor moves with its temperature.

    Formula
        ``E_aa = α·q_a·(mean(T_i) − T0)``, optionally with each T_i behind a first-order lag τ.
    Parameters
    ----------
        alpha, 1/K: the *effective* coefficient, fitted as the slope of scale error against
        temperature. Between −5 and 25 ppm/K: glass 8, steel 11.5, aluminium 23; a scale strained by
        its case or screw lies between its own and theirs (16, 10 and 13 ppm/K on one machine with
        three alike glass scales). Negative where the controller over-compensates.
    Signals
        One or more temperatures of the scale, °C; their mean is used. A lag (``tau`` in s, or
        ``tau = fit``) where the sensor sits on the case or in the air and the scale follows late.
    Typical causes
        Workshop temperature away from 20 °C, drive heat, sun on one side.
    Cure
        Live compensation with thermistors on the scale; scales that float in their case.
    Source
        Zhang et al., CIRP Annals 34/1 (1985), eq. 6.
    """

    kind = "scale_expansion"
    axis: str
    signals: Names

    def check(self, machine: Machine) -> None:
        """Linear axes and temperatures only."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)
        require_temperatures(machine, "signals", self.signals)

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The effective expansion coefficient."""
        return (Parameter("alpha", "1/K", (-5e-6, 25e-6), f"effective expansion of {self.axis}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``q_a·(T − T0)`` on E_aa; held at the ends of the travel."""
        mean = conditions.mean_signal(self.signals, self.lag(nonlinear))
        warmth = mean - machine.reference_temperature
        position = machine.axis(self.axis).clamp(conditions.position(self.axis))
        return (Motion(along(self.axis), (position * warmth)[:, None]),)

    def warmed(self) -> tuple[str, ...]:
        """All signals: their mean is the scale's temperature."""
        return self.signals

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travel."""
        return {self.axis: machine.axis(self.axis).travel}

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[ScaleExpansion]:
        """Each moving linear axis with its scale's sensors, then every other; then lagged."""
        temperatures = recorded(machine, coverage, temperature=True)
        for tau in (None, "fit"):
            for axis in machine.structure.linear:
                if axis not in coverage.moving:
                    continue
                scale = [s.name for s in temperatures if s.axis == axis and s.role == "scale"]
                if len(scale) > 1:
                    yield cls(axis=axis, signals=tuple(scale), tau=tau)
                for signal in by_sense(temperatures, ("scale", "screw"), axis):
                    yield cls(axis=axis, signals=(signal.name,), tau=tau)


_SHRINKS = -5e-6
"""1/K: below it a screw surely shrinks as it warms. Per mm/min of feed nothing comes near."""


@register
class ScrewHeating(LaggedEffect):
    """A ball screw that warms while it works and stretches away from its fixed bearing.

    Where the position comes from the motor's encoder, the screw is the scale. It warms by friction
    of the nut, unevenly and within minutes, and grows away from the bearing that holds it.

    Formula
        ``E_aa = k·(q_a − q_fixed)·heat``; heat is T − T0 of a temperature, else the signal itself
        (feed, speed), optionally behind a first-order lag τ. q_fixed: where the fixed bearing is,
        key ``fixed`` in mm; by default the end of the travel that lies nearer to the axis's zero.
    Parameters
    ----------
        k in 1/K: the expansion coefficient of steel, 11.5 ppm/K, for the screw's mean temperature;
        between −5 and 40 ppm/K (a sensor at the nut sees more than the screw). Per mm/min of feed
        and the like: within ±500 ppm over the signal's common range.
    Signals
        One: screw or nut temperature (role ``screw``), or what heats it, feed or speed, with a lag
        of 5 to 60 minutes.
    Typical causes
        Fast and frequent positioning, high preload, grease in place of oil, a motor flanged to the
        bearing.
    Cure
        Linear scale; a stretched or hollow, cooled screw; less preload; live compensation.
    Source
        ISO 230-3 (distortion by linear motion); Mayr et al., CIRP Annals 61/2 (2012), 771-791.
    """

    kind = "screw_heating"
    axis: str
    signal: str
    fixed: Finite | None = None

    def check(self, machine: Machine) -> None:
        """Linear axes only."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The expansion by heat."""
        signal = machine.signals[self.signal]
        most = 5e-4 / typical(signal).change
        plausible = (_SHRINKS, 40e-6) if signal.temperature else (-most, most)
        text = f"expansion of the screw of {self.axis}"
        return (Parameter("k", per("1", signal), plausible, text),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``(q_a − q_fixed)·heat`` on E_aa; held at the ends of the travel."""
        axis = machine.axis(self.axis)
        fixed = min(axis.travel, key=abs) if self.fixed is None else self.fixed
        heat = excess(machine, conditions, self.signal, self.lag(nonlinear))
        reach = axis.clamp(conditions.position(self.axis)) - fixed
        return (Motion(along(self.axis), (reach * heat)[:, None]),)

    def misnamed(self, values: Mapping[str, float]) -> bool:
        """Whether the screw would shrink as it warms: then its bearing is not there, or no screw.

        Behind a lag and beside an expansion at once that is a thermometer which follows late.
        """
        return self.tau is None and values["k"] < _SHRINKS

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The ends of the travel."""
        return {self.axis: machine.axis(self.axis).travel}

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[ScrewHeating]:
        """Each moving linear axis with screw temperatures, then with what heats it, lagged.

        The bearing at the end near zero, then at the other end.
        """
        signals = [s for s in recorded(machine, coverage) if heats(s)]
        for axis in (a for a in machine.structure.linear if a in coverage.moving):
            low, high = machine.axis(axis).travel
            far = high if min(low, high, key=abs) == low else low
            for signal in by_sense(signals, ("screw", "speed"), axis):
                if signal.role not in ("screw", "speed") and signal.axis != axis:
                    continue
                for fixed in (None, far):
                    if signal.temperature:
                        yield cls(axis=axis, signal=signal.name, fixed=fixed)
                    yield cls(axis=axis, signal=signal.name, fixed=fixed, tau="fit")
