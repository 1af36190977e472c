"""Typical ranges of signals in a workshop, by role and unit; narrower than the plausible ones.

Where no measurement says more, effects take from here how large a coefficient may be, and the live
tables for which temperatures and loads they are laid out.
"""

from __future__ import annotations

from typing import NamedTuple

from abbe.compcore.machine.machine import Machine, Signal
from abbe.compcore.machine.plausible import usual_unit


class Typical(NamedTuple):
    """The typical range of a signal in a workshop, in its own unit.

    Attributes
    ----------
    low, high
        Where it commonly is; of temperatures counted from the reference temperature.
    change
        A large but common change.
    """

    low: float = -1.0
    high: float = 1.0
    change: float = 1.0


_BY_UNIT = {
    "degC": Typical(-20.0, 20.0, 10.0),
    "K": Typical(-20.0, 20.0, 10.0),
    "rpm": Typical(0.0, 2e4, 1e4),
    "kg": Typical(0.0, 1e3, 1e3),
    "N": Typical(0.0, 1e4, 1e4),
    "kN": Typical(0.0, 10.0, 10.0),
    "mm/min": Typical(0.0, 2e4, 1e4),
    "m/min": Typical(0.0, 20.0, 10.0),
    "mm/s": Typical(0.0, 400.0, 200.0),
    "hPa": Typical(900.0, 1100.0, 50.0),
    "mbar": Typical(900.0, 1100.0, 50.0),
    "Pa": Typical(9e4, 1.1e5, 5e3),
    "kPa": Typical(90.0, 110.0, 5.0),
    "bar": Typical(0.0, 10.0, 5.0),
    "%": Typical(0.0, 100.0, 50.0),
    "A": Typical(0.0, 40.0, 20.0),
    "V": Typical(0.0, 20.0, 10.0),
    "W": Typical(0.0, 2e4, 1e4),
    "kW": Typical(0.0, 20.0, 10.0),
    "s": Typical(0.0, 1e5, 1.0),
}


def typical(signal: Signal) -> Typical:
    """The typical range of a signal by its unit; −1 to 1 where the unit is unknown.

    >>> typical(Signal("n", "1/min")).high
    20000.0
    """
    return _BY_UNIT.get(usual_unit(signal), Typical())


def typical_range(signal: Signal, machine: Machine) -> tuple[float, float]:
    """Least and greatest typical value of a signal; temperatures about the machine's reference."""
    zero = machine.reference_temperature if signal.temperature else 0.0
    found = typical(signal)
    return zero + found.low, zero + found.high
