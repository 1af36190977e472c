"""How the instruments of set-ups stand in full: the rigid motions that bring points to readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.effects.catalogue.instruments.setup import frame_columns
from abbe.compcore.fitting.design.nuisance import SetupNuisances
from abbe.compcore.fitting.design.turned_frames import Seen, TurnedFrames, turn_by, turn_of

F64 = NDArray[np.float64]

_ROUNDS = 20
_SETTLED = 1e-9
"""mm or rad: what a further step may still move a reading by."""
_ROWS = 2000
"""Rows of a set-up from which its frame is found; the rest is small, and taken out by columns."""
_RANK = 1e-9
_FRAME = 6
"""Columns of a frame; they stand last among those of a set-up."""


def turned_frames(
    campaign: Campaign,
    weight: F64,
    blocks: Sequence[SetupNuisances],
    seen: Seen,
    near: TurnedFrames | None = None,
) -> TurnedFrames | None:
    """The frames that bring a model's points nearest to what was read; None where none is free.

    Gauss–Newton, set-up by set-up, zero and slope beside it. Set-ups that
    measure distances from base points have no frame of their own.

    Parameters
    ----------
    weight
        1/sd of each row, (n,).
    blocks
        The set-ups' nuisances to first order (`setup_blocks`).
    near
        Frames to begin with, such as those of a model that is nearly the same; default: as stated.
    """
    of_row = np.full(campaign.n, -1, dtype=np.int64)
    names: list[str] = []
    rotations: list[F64] = []
    shifts: list[F64] = []
    values: dict[str, dict[str, tuple[float, str]]] = {}
    for block in blocks:
        if "frame x" not in block.names or np.any(campaign.kind[block.rows] >= Kind.DISTANCE):
            continue
        begun = np.eye(3), np.zeros(3)
        if near is not None and block.setup in near.names:
            k = near.names.index(block.setup)
            begun = near.rotation[k], near.shift[k]
        rotation, shift = _found(block, weight, seen, *begun)
        of_row[block.rows] = len(names)
        names.append(block.setup)
        rotations.append(rotation)
        shifts.append(shift)
        middle = seen.point[block.rows].mean(axis=0)
        stands = [
            *(rotation @ middle + shift - middle),
            *turn_of(rotation),
        ]
        values[block.setup] = {
            name: (float(v), unit)
            for name, v, unit in zip(
                block.names[-_FRAME:], stands, block.units[-_FRAME:], strict=True
            )
        }
    if not names:
        return None
    return TurnedFrames(tuple(names), of_row, np.array(rotations), np.array(shifts), values)


def _found(
    block: SetupNuisances, weight: F64, seen: Seen, rotation: F64, shift: F64
) -> tuple[F64, F64]:
    """Rotation (3, 3) and shift (3,) of one set-up's instrument."""
    step = 1 + (len(block.rows) - 1) // _ROWS
    rows, others = block.rows[::step], block.columns[::step, :-_FRAME]
    w = weight[rows]
    toward, about, actual = seen.toward[rows], seen.about[rows], seen.actual[rows]
    turns = bool(about.any())
    for _ in range(_ROUNDS):
        placed = actual @ rotation.T + shift
        moved = np.einsum("ni,ni->n", toward, placed - actual)
        if turns:
            moved += about @ turn_of(rotation)
        columns = np.hstack([others, frame_columns(placed, toward, about)])
        size = np.linalg.norm(columns * w[:, None], axis=0)
        size[size <= 0.0] = 1.0
        scaled = columns * w[:, None] / size
        found = np.linalg.lstsq(scaled, (seen.value[rows] - moved) * w, rcond=_RANK)[0] / size
        own = found[-_FRAME:]
        further = turn_by(own[3:])
        middle = placed.mean(axis=0)
        rotation = further @ rotation
        shift = further @ (shift - middle) + middle + own[:3]
        if float(np.abs(columns[:, -_FRAME:] @ own).max()) < _SETTLED:
            break
    return rotation, shift
