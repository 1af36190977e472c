"""The simulated bridge CMM as I++ DME shows it: positions, temperatures, tool.

Positions are those of the probe tip: the indicated axis positions plus the tool's offset, without
any correction by the controller. A scale's temperature is the mean of its two thermistors; the
part has the temperature of the air about it, as `Part.Temperature` of a server that measures it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import TypeVar

from abbe.drivers.simulated.bridge.machine import AXES, PLACES, SCALE_SENSORS
from abbe.drivers.simulated.bridge.plant import Plant
from abbe.drivers.simulated.ipp.rotary_table import SimulatedTable

_Value = TypeVar("_Value")

COORDINATES = ("MachineCsy", "MoveableMachineCsy", "MultipleArmCsy", "RotaryTableVarCsy", "PartCsy")


class UnknownError(LookupError):
    """The machine has no such axis, or no such property."""


class ScaleSensorError(LookupError):
    """A scale's temperature cannot be told."""


class IppMachine:
    """The bridge as an I++ DME server shows it.

    Parameters
    ----------
    plant
        The running machine.
    rotary
        Whether there is a rotary table; it turns by 0.1°/s.

    Attributes
    ----------
    plant
        As given.
    coordinates
        In which system positions are; the part's lies 100, 200, −50 mm off the machine's.
    table
        A rotary table that turns when it is told; None: there is none, but for `rotary`.
    """

    def __init__(self, plant: Plant, *, rotary: bool = False) -> None:
        self.plant = plant
        self._rotary = rotary
        self._began = time.monotonic()
        self.coordinates = "MachineCsy"
        self.table: SimulatedTable | None = None

    def axes(self, names: Sequence[str]) -> dict[str, float]:
        """Positions of axes, mm and degrees, all of one controller cycle.

        Raises
        ------
        UnknownError
            When there is no such axis.
        """
        now = time.monotonic()
        latch = self.plant.latch(now)
        origin = (100.0, 200.0, -50.0) if self.coordinates == "PartCsy" else (0.0, 0.0, 0.0)
        known = {
            axis: latch.position[i] + self.plant.tool[i] - origin[i] for i, axis in enumerate(AXES)
        } | {"Tool.A": 0.0, "Tool.B": 90.0}
        if self._rotary:
            known["R"] = math.fmod(0.1 * (now - self._began), 360.0)
        if self.table is not None:
            known["R"] = self.table.angle
        return {name: round(_found(known, name), 5) for name in names}

    def property(self, name: str) -> tuple[object, ...]:
        """A property's values.

        Raises
        ------
        UnknownError
            When there is no such property.
        """
        temperatures = self._places()
        known: dict[str, tuple[object, ...]] = {
            "Part.Temperature": (round(temperatures["T_amb"], 4),),
            "Part.XpanCoefficient": (11.5,),
            "Tool.Name": ("Probe1",),
            "Tool.Alignment": (0.0, 0.0, 1.0),
            "Tool.AvrOffsets": self.plant.tool,
        }
        return _found(known, name)

    def scale_temperatures(self, axes: Sequence[str]) -> dict[str, float]:
        """Temperatures of scales, °C.

        Raises
        ------
        UnknownError
            When there is no such scale.
        ScaleSensorError
            When one of its thermistors is broken.
        """
        places = self._places()
        broken = self.plant.disturbances.thermistors_open
        for axis in axes:
            if any(broken >> PLACES.index(p) & 1 for p in _found(SCALE_SENSORS, axis)):
                raise ScaleSensorError(axis)
        return {
            axis: round(0.5 * sum(places[place] for place in _found(SCALE_SENSORS, axis)), 4)
            for axis in axes
        }

    def _places(self) -> dict[str, float]:
        latch, machine = self.plant.latch(time.monotonic()), self.plant.machine
        shown = (latch.temperatures + machine.sensor_errors).tolist()
        return dict(zip(PLACES, shown, strict=True))


def _found(known: Mapping[str, _Value], name: str) -> _Value:
    if name not in known:
        raise UnknownError(name)
    return known[name]
