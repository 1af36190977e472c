"""Whether a campaign told a parameter anything: more than that it lies where all of them do."""

from __future__ import annotations

from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Value

_ALL_OF_IT = 0.99
"""Part of half the plausible range from which on an uncertainty is no knowledge."""


def untold(effect: Effect, machine: Machine) -> dict[str, float]:
    """By parameter the least standard uncertainty that says nothing of it, units inside the code.

    Half of its plausible range, over which it was uncertain before anything was measured.
    """
    ranges = {p.name: p.plausible for p in effect.linear(machine)}
    ranges |= {p.name: p.plausible for p in effect.nonlinear(machine)}
    return {name: _ALL_OF_IT * 0.5 * (high - low) for name, (low, high) in ranges.items()}


def not_told(value: Value, least: float) -> bool:
    """Whether a value is not measured: by the campaign's design, or ± more than is plausible."""
    if not value.measured:
        return True
    return value.sd is not None and 0.0 < least <= value.sd and abs(value.value) < value.sd
