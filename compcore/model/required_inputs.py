"""The inputs that a model requires besides positions: signals, time, approach directions."""

from __future__ import annotations

from dataclasses import dataclass

from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.model.reads import reads_of

_ROOM_TEMPERATURE = 20.0


@dataclass(frozen=True)
class RequiredInputs:
    """The inputs of a model's fitted effects besides positions and tool.

    Attributes
    ----------
    signals
        Signals, in the order of the machine's section, as they stand or behind a lag.
    lagged
        Those that are read behind a first-order lag, for which the past matters.
    clock
        Whether the time itself is read.
    directions
        Axes whose approach direction is read.
    """

    signals: tuple[str, ...]
    lagged: tuple[str, ...]
    clock: bool
    directions: tuple[str, ...]

    @classmethod
    def of(cls, model: Model) -> RequiredInputs:
        """The inputs of a model, found by evaluating its effects on recording conditions."""
        machine = model.machine
        probe = Conditions.at(
            {a: machine.axis(a).middle for a in machine.structure.axes},
            directions=dict.fromkeys(machine.structure.axes, 1.0),
            signals=dict.fromkeys(machine.signals, _ROOM_TEMPERATURE),
        )
        reads = reads_of(model.error_motions, probe)
        lagged = {name for name, _ in reads.lags}
        read = reads.signals | lagged | set(model.signals_needed())
        return cls(
            tuple(s for s in machine.signals if s in read),
            tuple(s for s in machine.signals if s in lagged),
            "time" in reads.others,
            tuple(a for a in machine.structure.axes if a in reads.directions),
        )


def validity(model: Model) -> dict[str, tuple[float, float]]:
    """Axis → the range, mm (rotary: rad), in which no end value is held: travel and all tables.

    mm (rotary: rad).
    """
    machine = model.machine
    found: dict[str, tuple[float, float]] = {}
    for axis in machine.structure.axes:
        low, high = machine.axis(axis).travel
        for nodes in _tables(model, machine, axis):
            low, high = max(low, nodes[0]), min(high, nodes[-1])
        found[axis] = (low, high)
    return found


def _tables(model: Model, machine: Machine, axis: str) -> list[tuple[float, ...]]:
    return [
        effect.parsed_shape(machine).nodes
        for effect in model.effects
        if isinstance(effect, ShapedEffect) and effect.axis == axis and effect.shape == "table"
    ]
