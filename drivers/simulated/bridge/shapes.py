"""Smooth random error motions, of shapes that no spline or polynomial on the travel can be.

Each motion is a sum of sinusoids of irregular wavelengths, a Gaussian bump (a worn or repaired
place of a guideway) and a power term of broken degree (a beam that sags). The seed decides
all of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

WAVELENGTHS = ((0.9, 1.7), (0.5, 0.8), (0.32, 0.45))
"""Ranges of the sinusoids' wavelengths, as shares of the travel."""

HEIGHTS = (1.0, 0.45, 0.12)
"""Their relative amplitudes."""


@dataclass(frozen=True)
class SmoothMotions:
    """Six error motions of one axis as functions of its position.

    Attributes
    ----------
    travel
        Ends of the axis's travel, mm.
    heights, wavelengths, phases
        Sinusoids, shape (6, 3): mm or rad; shares of the travel; rad.
    bumps
        Height, centre and width of a Gaussian, shape (6, 3): mm or rad; shares of the travel.
    powers
        Factor, centre and exponent of ``|u − centre|^exponent``, shape (6, 3).
    line
        Offset and slope over the travel that are added, shape (6, 2).
    """

    travel: tuple[float, float]
    heights: Array
    wavelengths: Array
    phases: Array
    bumps: Array
    powers: Array
    line: Array

    def __call__(self, position: ArrayLike) -> Array:
        """The six motions at positions (...) in mm: shape (..., 6), mm and rad."""
        low, high = self.travel
        u = ((np.asarray(position, dtype=float) - low) / (high - low))[..., None]
        waves = np.sin(2.0 * np.pi * u[..., None] / self.wavelengths + self.phases)
        height, centre, width = self.bumps.T
        factor, origin, exponent = self.powers.T
        out: Array = (
            (self.heights * waves).sum(axis=-1)
            + height * np.exp(-0.5 * ((u - centre) / width) ** 2)
            + factor * np.abs(u - origin) ** exponent
            + self.line[:, 0]
            + self.line[:, 1] * u
        )
        return out

    def scaled(self, factor: ArrayLike) -> SmoothMotions:
        """The same shapes, `factor` times as large: one factor, or one per motion (6,)."""
        f = np.broadcast_to(np.asarray(factor, dtype=float), 6)[:, None]
        bumps, powers = self.bumps.copy(), self.powers.copy()
        bumps[:, :1] *= f
        powers[:, :1] *= f
        return replace(
            self, heights=self.heights * f, bumps=bumps, powers=powers, line=self.line * f
        )


def random_motions(
    rng: np.random.Generator,
    travel: tuple[float, float],
    span: ArrayLike,
    slope: ArrayLike,
    zero_at: float,
) -> SmoothMotions:
    """Draw six motions.

    Parameters
    ----------
    rng
        The seed's generator.
    travel
        Ends of the axis's travel, mm.
    span
        Peak-to-peak size of each motion about its mean line over the travel, mm or rad, shape (6,).
    slope
        Rise of each motion's mean line (least squares) over the travel, mm or rad, shape (6,): a
        straightness has none, by its definition; a scale has much.
    zero_at
        Position (mm) at which every motion is 0.
    """
    wavelengths = np.stack([rng.uniform(*bounds, 6) for bounds in WAVELENGTHS], axis=-1)
    drawn = SmoothMotions(
        travel,
        np.asarray(HEIGHTS) * rng.uniform(0.6, 1.4, (6, 3)),
        wavelengths,
        rng.uniform(0.0, 2.0 * np.pi, (6, 3)),
        np.stack(
            [
                rng.choice([-1.0, 1.0], 6) * rng.uniform(0.4, 0.8, 6),
                rng.uniform(0.15, 0.85, 6),
                rng.uniform(0.12, 0.22, 6),
            ],
            axis=-1,
        ),
        np.stack(
            [rng.uniform(-2.0, 2.0, 6), rng.uniform(0.0, 1.0, 6), rng.uniform(1.7, 2.8, 6)],
            axis=-1,
        ),
        np.zeros((6, 2)),
    )
    u = np.linspace(0.0, 1.0, 201)
    values = drawn(travel[0] + (travel[1] - travel[0]) * u)
    trend, offset = np.polyfit(u, values, 1)
    size = np.asarray(span, dtype=float) / np.ptp(values - offset - u[:, None] * trend, axis=0)
    sized = drawn.scaled(size)
    # Without its own mean slope, with the wanted one, and 0 at `zero_at`.
    line = np.stack([np.zeros(6), np.asarray(slope, dtype=float) - size * trend], axis=-1)
    line[:, 0] = -replace(sized, line=line)(zero_at)
    return replace(sized, line=line)
