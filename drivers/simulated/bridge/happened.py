"""What happens to a machine in the years after it was measured: a crash, levelling, ageing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.machine import (
    PLACES,
    REFERENCE_TEMPERATURE,
    SCALE_SENSORS,
    BridgeMachine,
)
from abbe.drivers.simulated.bridge.truth import SixErrors, State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Happened:
    """What has happened to a machine; by default nothing.

    Attributes
    ----------
    squareness
        A crash: the X guideway is turned about z on its carriage, rad.
    twist
        The bed was levelled anew: Y's carriage rolls by so much more per mm of its way, rad/mm.
    sensors
        The thermistors on X's scale age: they read so much more, K.
    growth
        The bearings of the quill age: it grows by so much more per kelvin, mm/K.
    """

    squareness: float = 0.0
    twist: float = 0.0
    sensors: float = 0.0
    growth: float = 0.0

    def to(self, machine: BridgeMachine) -> BridgeMachine:
        """The machine as it is then."""
        axes = dict(machine.exact.axes)
        mount = np.array(axes["X"].mount, dtype=float)
        mount[5] += self.squareness
        axes["X"] = replace(axes["X"], mount=tuple(mount.tolist()))
        axes["Y"] = replace(axes["Y"], error=_with(axes["Y"].error, self._roll))
        axes["Z"] = replace(axes["Z"], error=_with(axes["Z"].error, self._longer))
        errors = machine.sensor_errors.copy()
        for name in SCALE_SENSORS["X"]:
            errors[PLACES.index(name)] += self.sensors
        return replace(machine, exact=replace(machine.exact, axes=axes), sensor_errors=errors)

    def _roll(self, state: State) -> Array:
        at = np.asarray(state["Y"], dtype=float)
        six = np.zeros((*at.shape, 6))
        six[..., 4] = self.twist * at
        return six

    def _longer(self, state: State) -> Array:
        one, other = SCALE_SENSORS["Z"]
        mean = 0.5 * (np.asarray(state[one]) + np.asarray(state[other]))
        six = np.zeros((*mean.shape, 6))
        # a quill that hangs down takes its tip along
        six[..., 2] = -self.growth * (mean - REFERENCE_TEMPERATURE)
        return six


def _with(error: SixErrors | None, more: SixErrors) -> SixErrors:
    if error is None:
        return more
    before = error
    return lambda state: np.add(before(state), more(state))
