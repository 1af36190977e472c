"""Air-bearing carriages float higher when the supply pressure rises: an effect for Abbe.

This one file and the entry point in ``pyproject.toml`` are all that a new effect takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects import Effect, Motion, Parameter
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import AxisLetter, ErrorMotion
from abbe.compcore.machine.machine import Machine


class AirBearingLift(Effect):
    """An air-bearing carriage floats higher when its supply pressure rises.

    The gap of an aerostatic bearing grows with the pressure at its inlet. Compressors that switch
    on and off move the carriage by micrometres, minutes apart.

    Formula
        ``E_da = c·(p − p_0)``, p the supply pressure, p_0 the pressure at which the machine was
        adjusted (key ``nominal``, in the signal's unit).

    Parameters
    ----------
        c in mm per unit of pressure; within ±5 µm/bar: the gap is 5 to 15 µm and changes by about
        a tenth of itself per bar.
    Signals
        The supply pressure, in bar.
    Typical causes
        No regulator, or one that is too small for the flow; a compressor with a wide dead band.
    Cure
        A precision regulator and a buffer volume at the machine.
    Source
        Powell, Design of Aerostatic Bearings (1970).
    """

    kind = "air_bearing_lift"
    axis: str
    direction: AxisLetter
    signal: str
    nominal: float = 5.0

    def check(self, machine: Machine) -> None:
        """The signal is a pressure in bar."""
        super().check(machine)
        unit = machine.signals[self.signal].unit
        if unit != "bar":
            raise InputError("not a pressure", field="signal", found=unit, expected="bar")

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """Lift per pressure."""
        return (Parameter("c", "mm/bar", (-0.005, 0.005), f"lift of {self.axis}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``p − p_0`` on the carriage."""
        excess = conditions.signal(self.signal) - self.nominal
        return (Motion(ErrorMotion(self.axis, self.direction), excess[:, None]),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None: the carriage floats alike wherever it stands."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[AirBearingLift]:
        """Each pressure that varied, on each axis; lifts along Z first."""
        for signal in machine.signals.values():
            if signal.unit == "bar" and signal.name in coverage.signals:
                for direction in ("Z", "X", "Y"):
                    for axis in machine.structure.linear:
                        yield cls(axis=axis, direction=direction, signal=signal.name)
