"""One measurement of a calibrated length by a machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_length import CalibratedLength

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MeasuredLength:
    """A calibrated length as a machine measured it once.

    Attributes
    ----------
    position
        Where and in which orientation, by any name.
    calibrated
        What the length is.
    measured
        What the machine says that it is, mm.
    run
        The number of the repeat, from 1.
    temperature
        Of the standard while it was measured, °C; None where `measured` is already reduced to
        20 °C, or nobody knows better.
    temperature_sd
        Its standard uncertainty, K.
    test
        ``E0`` (tip on the ram's axis) or ``E150`` (150 mm beside it).
    ends
        The two points that were probed, shape (2, 3), machine coordinates as indicated, mm; None
        where only the length is known.
    tool
        Offset of the probe's tip, mm.
    signals
        What was recorded besides: name → value in the signal's own unit.
    line
        Line in the file, for people.
    """

    position: str
    calibrated: CalibratedLength
    measured: float
    run: int = 1
    temperature: float | None = None
    temperature_sd: float = 0.0
    test: str = "E0"
    ends: F64 | None = None
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    signals: Mapping[str, float] = field(default_factory=dict)
    line: int = 0

    @property
    def error(self) -> float:
        """Error of indication: measured − calibrated at the standard's temperature, mm."""
        return self.measured - self.calibrated.at(self.temperature)

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of what the length was at its temperature, mm."""
        return self.calibrated.uncertainty(self.temperature, self.temperature_sd)
