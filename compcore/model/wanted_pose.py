"""A pose that is wanted, how far a machine that errs is from it, and the command that was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import NotContractionError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, crossed
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Command:
    """The commanded positions at n points, and the part of the pose that they do not reach.

    Attributes
    ----------
    conditions
        The target's conditions with the commanded positions.
    direction_left, spin_left
        Angle between the tool and where it should point, and its turn about itself against what it
        should be, each (n,), rad. The second does not matter where a spindle turns the tool.
    place_left
        Distance of the functional point from where it should be, (n,), mm: 0 where X, Y and Z
        carry it, which reach every point.
    damped
        Whether something is left because a rotary axis stands near a pole, (n,).
    limited
        Whether a rotary axis would have to turn by more than allowed, or out of its travel, (n,).
    rounds
        Of the iteration, at the slowest point.
    contraction
        Estimated factor by which a round brought the point nearer, shape (n,).
    """

    conditions: Conditions
    direction_left: F64
    spin_left: F64
    place_left: F64
    damped: NDArray[np.bool_]
    limited: NDArray[np.bool_]
    rounds: int
    contraction: F64


def no_command(machine: Machine, target: Conditions, size: F64) -> NotContractionError:
    """The error of an iteration that does not end, naming the point whose steps stay greatest.

    `size` is each point's last step, (n,), mm; not finite where it ran away.
    """
    row = int(np.argmax(np.where(np.isfinite(size), size, np.inf)))
    where = ", ".join(f"{a}={target.position(a)[row]:g}" for a in machine.structure.axes)
    return NotContractionError(
        f"no command was found for {where} (mm, rad): the error changes too fast with position; "
        "look for a wrong unit"
    )


@dataclass(frozen=True, eq=False)
class FoundPose:
    """Where the tool is, seen from where it should be; vectors in the workpiece's frame."""

    chain: Chain
    place: F64
    """From the tool's place to the wanted one, (n, 3), mm."""
    direction: F64
    """Wanted direction of the tool, (n, 3)."""
    across: F64
    """By what it has to be turned to point there, (n, 3), rad, square to `direction`."""
    spin: F64
    """By what it then has to be turned about itself, (n,), rad."""


class WantedPose:
    """The wanted pose, and how far a machine that errs is from it."""

    def __init__(self, model: Model, wanted: Chain, axis: int) -> None:
        self._model, self._wanted, self._axis = model, wanted, axis

    def at(self, conditions: Conditions) -> FoundPose:
        """The pose at commanded positions."""
        chain = Chain(self._model.machine, conditions)
        predicted = self._model.predict(conditions)
        place = chain.point + chain.to_workpiece(predicted.translation)
        axes = chain.orientation  # columns: directions at the tool
        turned = np.stack(
            [
                chain.to_workpiece(
                    np.einsum(
                        "nij,nj->ni", predicted.orientation, chain.to_machine_axes(axes[:, :, k])
                    )
                )
                for k in range(3)
            ],
            axis=2,
        )
        wanted = self._wanted.orientation
        turn = 0.5 * sum(crossed(turned[:, :, k], wanted[:, :, k]) for k in range(3))
        direction = wanted[:, :, self._axis]
        actual = turned[:, :, self._axis]
        across = crossed(actual / np.linalg.norm(actual, axis=1)[:, None], direction)
        spin = np.einsum("ni,ni->n", np.asarray(turn), direction)
        return FoundPose(chain, self._wanted.point - place, direction, across, spin)
