"""Ball plates and hole plates: calibrated points of a body that stands somewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_length import CalibratedLength

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MeasuredPlate:
    """A plate of calibrated points as a machine measured it in one placing.

    Attributes
    ----------
    placing
        Its name.
    points
        Names of the n balls or holes.
    calibrated
        Their coordinates at 20 °C in the plate's own frame, shape (n, 3), mm.
    planar
        Whether the plate has no third coordinate (holes): errors across it are not its matter.
    indicated
        The centres as the machine indicates them, shape (n, 3), machine coordinates, mm.
    sd
        Standard uncertainty of a calibrated coordinate, mm.
    expansion
        1/K.
    temperature
        Of the plate at each point, shape (n,), °C; None: 20 °C.
    tool
        Offset of the probe's tip, shape (n, 3), mm.
    signals
        Name → shape (n,), in the signal's own unit.
    line
        Shape (n,): line in the file.
    """

    placing: str
    points: tuple[str, ...]
    calibrated: F64
    planar: bool
    indicated: F64
    sd: float = 0.0
    expansion: float = 0.0
    temperature: F64 | None = None
    tool: F64 = field(default_factory=lambda: np.zeros((0, 3)))
    signals: Mapping[str, F64] = field(default_factory=dict)
    line: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def actual(self) -> F64:
        """The points at the plate's temperature, in its own frame, shape (n, 3), mm."""
        mean = None if self.temperature is None else float(np.mean(self.temperature))
        return self.calibrated * CalibratedLength(1.0, expansion=self.expansion).at(mean)

    def placed(self, indicated: F64 | None = None) -> F64:
        """The points where the plate stands: the rigid placing next to what is indicated, (n, 3).

        Least squares over all points (Kabsch), mm, machine coordinates. `indicated` stands for the
        plate's own where it was corrected.
        """
        to = self.indicated if indicated is None else indicated
        turn, shift = rigid_placing(self.actual, to)
        return np.asarray(self.actual @ turn.T + shift)

    def errors(self, indicated: F64 | None = None) -> F64:
        """Errors of indication, shape (n, 3), mm: indicated less placed; of holes in the plane."""
        to = self.indicated if indicated is None else indicated
        return np.asarray((to - self.placed(to)) @ self.calibrated_directions(to))

    def calibrated_directions(self, indicated: F64 | None = None) -> F64:
        """Projection onto the directions in which the plate is calibrated, shape (3, 3)."""
        if not self.planar:
            return np.eye(3)
        across = self.across(indicated)
        return np.asarray(np.eye(3) - np.outer(across, across))

    def across(self, indicated: F64 | None = None) -> F64:
        """Unit vector across the plate as it stands, shape (3,)."""
        to = self.indicated if indicated is None else indicated
        turn, _ = rigid_placing(self.actual, to)
        return np.asarray(turn[:, 2])

    def scale(self, indicated: F64 | None = None) -> float:
        """Relative error of length over the whole plate, mm/mm: indicated against calibrated."""
        to = self.indicated if indicated is None else indicated
        placed = self.placed(to)
        centred = placed - placed.mean(axis=0)
        return float((self.errors(to) * centred).sum() / (centred**2).sum())

    def worst_length(self, indicated: F64 | None = None) -> tuple[str, str, float]:
        """The two points whose distance is most wrong: names and error of indication, mm."""
        to = self.indicated if indicated is None else indicated
        i, j = np.triu_indices(len(self.points), 1)
        error = np.linalg.norm(to[i] - to[j], axis=1) - np.linalg.norm(
            self.actual[i] - self.actual[j], axis=1
        )
        k = int(np.argmax(np.abs(error)))
        return self.points[int(i[k])], self.points[int(j[k])], float(error[k])


def rigid_placing(points: F64, to: F64) -> tuple[F64, F64]:
    """Rotation (3, 3) and shift (3,) that bring points (n, 3) nearest to others, both mm."""
    middle, there = points.mean(axis=0), to.mean(axis=0)
    left, _, right = np.linalg.svd((to - there).T @ (points - middle))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn = left @ proper @ right
    return np.asarray(turn), np.asarray(there - turn @ middle)
