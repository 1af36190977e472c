"""Diagonal displacement tests by ISO 230-6, from a campaign's set-ups, and squareness from them.

A laser along a face or body diagonal sees scales, straightness and squareness together. Two
crossing diagonals of a plane differ by the squareness: hence the hints, which hold as far as the
machine's other errors are small along the diagonals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.repeats import SAME_POSITION, approach
from abbe.compcore.iso230.positioning import PositioningResult, evaluate_positioning, tabulate
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_STRAIGHT = 1e-3
"""How far off the diagonal a target may lie, as a share of its length."""
_ALONG = 0.9999
PLANES = (("X", "Y"), ("Y", "Z"), ("Z", "X"))
"""Planes in right-handed order: squareness is the angle from the first axis to the second − 90°."""


@dataclass(frozen=True, eq=False)
class Diagonal:
    """The results of one diagonal displacement test by ISO 230-6; lengths mm.

    Attributes
    ----------
    setup
        The set-up.
    name
        Its direction by signs: ``+X+Y`` (face), ``+X-Y+Z`` (body); the first sign is made +.
    direction
        Unit vector in machine axes.
    length
        From the first to the last target, mm.
    result
        The evaluation of ISO 230-2 along it (ISO 230-6:2002 takes over its formulas): E is the
        bidirectional systematic error of the diagonal, B its reversal; lengths along the diagonal.
    slope
        Relative change of length along it, mm/mm (mean of both directions).
    """

    setup: str
    name: str
    direction: tuple[float, float, float]
    length: float
    result: PositioningResult
    slope: float

    @property
    def body(self) -> bool:
        """Whether it is a body diagonal (three axes move) and no face diagonal."""
        return sum(c in "+-" for c in self.name) == 3


@dataclass(frozen=True)
class Diagonals:
    """The diagonal displacement tests of a campaign, and the squarenesses that follow.

    Attributes
    ----------
    diagonals
        In the campaign's order.
    E_body, E_face
        Greatest bidirectional systematic error of the body (ISO 230-6: E_d) and the face diagonals,
        mm; None where there are none, or not both directions.
    squareness
        (``X``, ``Y``) → angle from +X to +Y less 90°, rad, where the diagonals determine it.
    """

    diagonals: tuple[Diagonal, ...]
    E_body: float | None
    E_face: float | None
    squareness: Mapping[tuple[str, str], float]


def evaluate_diagonals(campaign: Campaign, machine: Machine) -> Diagonals:
    """Evaluate the face and body diagonals of a campaign (axes X, Y, Z) by ISO 230-6."""
    setup = campaign.conditions.setup
    found = []
    for name in campaign.setups if setup is not None else ():
        diagonal = _diagonal(campaign, machine, name, np.flatnonzero(setup == name))
        if diagonal is not None:
            found.append(diagonal)
    return Diagonals(
        tuple(found),
        _greatest([d.result.E for d in found if d.body]),
        _greatest([d.result.E for d in found if not d.body]),
        squareness_hints(found),
    )


def squareness_hints(diagonals: Sequence[Diagonal]) -> dict[tuple[str, str], float]:
    """Squarenesses from the slopes of diagonals: pair of axes → rad.

    To first order a diagonal of direction u changes its relative length by
    ``k_X u_X² + k_Y u_Y² + k_Z u_Z² − c_XY u_X u_Y − c_YZ u_Y u_Z − c_ZX u_Z u_X``: k the scales,
    c the excess of the angle between two axes over 90° (a wider angle shortens the diagonal
    between them). Least squares over all diagonals; only what they determine is returned.
    """
    if not diagonals:
        return {}
    u = np.array([d.direction for d in diagonals])
    pairs = [("XYZ".index(a), "XYZ".index(b)) for a, b in PLANES]
    columns = np.stack([*(u.T**2), *(-u[:, a] * u[:, b] for a, b in pairs)], axis=1)
    slopes = np.array([d.slope for d in diagonals])
    solution = np.linalg.pinv(columns, rcond=1e-9) @ slopes
    _, singular, directions = np.linalg.svd(columns)
    rank = int((singular > 1e-9 * singular[0]).sum())
    free = directions[rank:]
    return {
        plane: float(solution[3 + i])
        for i, plane in enumerate(PLANES)
        if not (np.abs(free[:, 3 + i]) > 1e-6).any() and columns[:, 3 + i].any()
    }


def _diagonal(
    campaign: Campaign, machine: Machine, name: str, rows: NDArray[np.int64]
) -> Diagonal | None:
    c = campaign.conditions
    if c.u is None or (campaign.kind[rows] != Kind.DISPLACEMENT).any():
        return None
    moving = [a for a, q in c.positions.items() if np.ptp(q[rows]) > SAME_POSITION]
    if not 2 <= len(moving) <= 3 or not set(moving) <= set("XYZ"):
        return None
    axes = sorted(moving)
    point = np.stack([c.positions[a][rows] for a in axes], axis=1)
    directions = np.array([machine.axes[a].direction for a in axes])
    path = (point - point[0]) @ directions
    far = path[int(np.argmax(np.linalg.norm(path, axis=1)))]
    u = far / np.linalg.norm(far)
    u = np.where(np.abs(u) < _STRAIGHT, 0.0, u)
    u *= np.sign(u[np.flatnonzero(u)[0]]) / np.linalg.norm(u)
    along = path @ u
    length = float(np.ptp(along))
    off = np.linalg.norm(path - along[:, None] * u, axis=1)
    measured = c.u[rows] @ u
    if (off > _STRAIGHT * length).any() or (np.abs(measured) < _ALONG).any():
        return None
    order = np.argsort(c.time[rows], kind="stable")
    rows, along = rows[order], along[order]
    lead = int(np.argmax(np.abs(directions @ u)))
    upwards = 1 if directions[lead] @ u > 0.0 else -1
    sense = approach(campaign, axes[lead])[rows] * upwards
    error = campaign.value[rows] * np.sign(measured)[order]
    label = "".join(f"{'+' if x > 0 else '-'}{a}" for a, x in zip("XYZ", u, strict=True) if x)
    result = evaluate_positioning(
        tabulate(name, label, "mm", along - along.min(), error, sense, SAME_POSITION)
    )
    x, y, z = u.tolist()
    return Diagonal(name, label, (x, y, z), length, result, _slope(result))


def _slope(result: PositioningResult) -> float:
    """Slope of the errors along the diagonal, the mean of what each direction was measured in."""
    slopes = []
    for mean in (result.mean_up, result.mean_down):
        known = np.isfinite(mean)
        if known.sum() > 1:
            slopes.append(float(np.polyfit(result.runs.targets[known], mean[known], 1)[0]))
    return float(np.mean(slopes)) if slopes else 0.0


def _greatest(values: Sequence[float | None]) -> float | None:
    return max((v for v in values if v is not None), default=None)
