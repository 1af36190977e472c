"""A plate as it lies: found by three of its balls, and where all of them are from then on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.artefacts.plate import rigid_placing
from abbe.compcore.artefacts.sphere import FittedSphere
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.planning.planned_setup import PlannedSetup

F64 = NDArray[np.float64]

_SAME_PLATE = 0.05
"""mm by which a plan's targets may differ from the plate's balls: they are rounded."""


class LyingPlate:
    """Where the balls of a plate are.

    Parameters
    ----------
    plate
        The plate.
    turn, shift
        From its own frame to the machine's, (3, 3) and (3,), mm.
    radius
        Of touched points about the middle of a ball, mm; None: not known.
    """

    def __init__(
        self, plate: CalibratedPlate, turn: F64, shift: F64, radius: float | None = None
    ) -> None:
        self.plate = plate
        self._turn, self._shift = turn, shift
        self.radius = radius

    @property
    def normal(self) -> F64:
        """The direction to which the balls look, unit vector."""
        return np.asarray(self._turn[:, 2])

    def at(self, temperature: float | None) -> F64:
        """The balls' middles, (n, 3), mm, machine coordinates."""
        return np.asarray(self.plate.at(temperature) @ self._turn.T + self._shift)

    @classmethod
    def planned(cls, plate: CalibratedPlate, setup: PlannedSetup) -> LyingPlate:
        """Where a plan has it.

        Raises
        ------
        InputError
            When its targets are not the plate's balls.
        """
        wanted = setup.path()
        if len(wanted) == len(plate.points):
            turn, shift = rigid_placing(plate.calibrated, wanted)
            found = cls(plate, turn, shift)
            away = float(np.linalg.norm(found.at(None) - wanted, axis=1).max())
            if away <= _SAME_PLATE:
                return found
            what = f"targets {away:.3f} mm off the balls"
        else:
            what = f"{len(wanted)} targets, {len(plate.points)} balls"
        raise InputError(
            f"set-up {setup.name} was not planned for this plate",
            field="probing.plate",
            found=what,
            expected="a plan by abbe plan --instruments ball-plate --plate of this file",
        )

    def found(
        self,
        numbers: Sequence[int],
        spheres: Sequence[FittedSphere],
        temperature: float | None,
        *,
        off: float,
        placing: float,
    ) -> LyingPlate:
        """Where it really lies, as some balls show.

        Parameters
        ----------
        off
            By which distances of these balls may differ from calibrated ones, mm.
        placing
            By which any ball may lie off the plan, mm.

        Raises
        ------
        AbbeError
            When these are not the plate's balls, or it lies too far off.
        """
        own = self.plate.at(temperature)[list(numbers)]
        centres = np.array([s.centre for s in spheres])
        turn, shift = rigid_placing(own, centres)
        beside = float(np.linalg.norm(own @ turn.T + shift - centres, axis=1).max())
        names = ", ".join(self.plate.points[i] for i in numbers)
        if beside > off:
            raise AbbeError(
                f"balls {names} do not lie to each other as calibrated ({beside:.2f} mm): another "
                "plate, or turned otherwise than planned"
            )
        lies = LyingPlate(self.plate, turn, shift, float(np.mean([s.radius for s in spheres])))
        away = np.linalg.norm(lies.at(temperature) - self.at(None), axis=1)
        if away.max() > placing:
            worst = self.plate.points[int(np.argmax(away))]
            raise AbbeError(
                f"the plate lies {away.max():.1f} mm off the plan at ball {worst}, more than "
                f"placing = {placing:g} mm"
            )
        return lies
