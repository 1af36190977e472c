"""A gauge as it lies: by its top, a side, the first face; and where its faces are from then on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.touches import unit

F64 = NDArray[np.float64]

_SAME_GAUGE = 0.05
"""mm by which a plan's targets may differ from the gauge's faces: they are rounded."""
_ACROSS = 0.05
"""Cosine of the angle to the stylus above which a gauge does not lie across it."""


@dataclass(frozen=True, eq=False)
class LyingGauge:
    """Where a gauge is.

    Attributes
    ----------
    gauge
        The gauge.
    origin
        Middle of its first face, (3,), mm, machine coordinates.
    along, up
        Unit vectors: along the gauge, and out of its top.
    """

    gauge: CalibratedGauge
    origin: F64
    along: F64
    up: F64

    @property
    def aside(self) -> F64:
        """Out of the side that is touched, unit vector."""
        return np.cross(self.up, self.along)

    def place(self, along: float, aside: float = 0.0, up: float = 0.0) -> F64:
        """A place in its own directions, mm from the middle of its first face, machine's."""
        return np.asarray(self.origin + along * self.along + aside * self.aside + up * self.up)

    @classmethod
    def planned(
        cls, gauge: CalibratedGauge, setup: PlannedSetup, shaft: tuple[float, float, float]
    ) -> LyingGauge:
        """Where a plan has it.

        Raises
        ------
        InputError
            When its targets are not the gauge's faces, or it does not lie across the stylus.
        """
        path = setup.path()
        along = unit(setup.u[0, 0].tolist())
        off = np.inf
        if len(path) == len(gauge.faces):
            off = float(np.abs(path - (path[0] + np.outer(gauge.places, along))).max())
        if off > _SAME_GAUGE:
            raise InputError(
                f"set-up {setup.name} was not planned for this gauge",
                field="probing.gauge",
                found=f"{len(path)} targets" if np.isinf(off) else f"targets {off:.3f} mm off",
                expected="a plan by abbe plan --instruments gauge-block --gauge of this file",
            )
        stylus = unit(shaft)
        if abs(float(along @ stylus)) > _ACROSS:
            raise InputError(
                f"the gauge of set-up {setup.name} does not lie across the stylus",
                field="probing.shaft",
                found=", ".join(f"{v:g}" for v in shaft),
                expected="a right angle to it: only so both of its ends are reached",
            )
        return cls(gauge, path[0], along, unit((stylus - (stylus @ along) * along).tolist()))

    def by_top(self, first: F64, second: F64, tip: float) -> LyingGauge:
        """As two touches of its top show it, the first of which gives the height."""
        along = unit((second - first).tolist())
        up = unit((self.up - (self.up @ along) * along).tolist())
        high = float((first - self.origin) @ up) - tip - 0.5 * self.gauge.height
        return LyingGauge(self.gauge, self.origin + high * up, along, up)

    def by_side(self, first: F64, second: F64, tip: float) -> LyingGauge:
        """As two touches of its side show it, the first of which gives the place."""
        along = unit((second - first).tolist())
        up = unit((self.up - (self.up @ along) * along).tolist())
        turned = LyingGauge(self.gauge, self.origin, along, up)
        off = float((first - self.origin) @ turned.aside) - tip - 0.5 * self.gauge.width
        return LyingGauge(self.gauge, self.origin + off * turned.aside, along, up)

    def by_face(self, touched: F64, tip: float) -> LyingGauge:
        """As a touch of its first face shows it."""
        off = float((touched - self.origin) @ self.along) + tip
        return LyingGauge(self.gauge, self.origin + off * self.along, self.along, self.up)

    def require_near(self, planned: LyingGauge, placing: float) -> None:
        """Refuse a gauge that lies elsewhere.

        Raises
        ------
        AbbeError
            When one of its ends lies more than `placing` mm off the plan in any direction.
        """
        for name, at in ((self.gauge.faces[0], 0.0), (self.gauge.faces[-1], self.gauge.length)):
            off = self.place(at) - planned.place(at)
            away = max(abs(float(off @ v)) for v in (planned.along, planned.aside, planned.up))
            if away > placing:
                raise AbbeError(
                    f"the gauge lies {away:.1f} mm off the plan at face {name}, more than "
                    f"placing = {placing:g} mm"
                )

    def shown(self, touched: F64, face: int, tip: float) -> float:
        """Where a face is along the gauge by a touch of it, mm."""
        side = float(self.gauge.sides[face])
        return float((touched - self.origin) @ self.along) - side * tip
