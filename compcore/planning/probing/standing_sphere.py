"""A sphere that stands on the table: where the tip meets it as rotary axes turn, and its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.iso10791.poses import following
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.room import post_of
from abbe.compcore.planning.probing.touches import unit

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StandardSphere:
    """A sphere on the table; where it stands nobody has to know.

    Attributes
    ----------
    diameter
        mm.
    """

    diameter: float


class StandingSphere:
    """Where a sphere stands.

    Parameters
    ----------
    machine
        The machine on whose table it stands.
    offset
        Of the tip from the axes' positions, mm.
    post
        The direction to which it looks out of its post with rotary axes at 0.
    shaft
        The direction from the tip to the probe, likewise.
    point
        Its middle, (3,), workpiece's frame, mm.
    radius
        Of touched points about its middle, mm; None: not known.
    """

    def __init__(
        self,
        machine: Machine,
        offset: F64,
        post: F64,
        shaft: F64,
        point: F64,
        radius: float | None = None,
    ) -> None:
        self._machine, self._offset, self._post, self._shaft = machine, offset, post, shaft
        self.point = point
        self.radius = radius

    @classmethod
    def planned(
        cls, machine: Machine, setup: PlannedSetup, shaft: Sequence[float]
    ) -> StandingSphere:
        """Where a plan has it: where its targets put the tip.

        Raises
        ------
        InputError
            When the tip is not at one place of the workpiece at all of them.
        """
        tools = np.tile(np.asarray(setup.offset), (setup.count, 1))
        points = Chain(machine, Conditions(dict(setup.targets), tool=tools)).point
        beside = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
        if beside > 0.05:
            raise InputError(
                f"set-up {setup.name} does not follow one sphere", field="setups",
                found=f"targets {beside:.3f} mm off their mean on the table",
                expected="a plan by abbe plan --instruments sphere",
            )  # fmt: skip
        post = post_of(machine, setup.offset)
        return cls(machine, np.asarray(setup.offset), post, unit(shaft), points.mean(axis=0))

    def at(self, angles: Mapping[str, float]) -> F64:
        """Its middle as the tip counts, (3,), mm, with rotary axes (rad) at some angles."""
        place = self.axes(angles)
        return np.array([place[a] for a in "XYZ"]) + self._offset

    def normal(self, angles: Mapping[str, float]) -> F64:
        """The direction to which it looks, unit vector, machine axes."""
        chain = self._chain({**self.axes(angles)})
        return np.asarray(chain.to_machine_axes(self._post[None, :])[0])

    def shaft(self, angles: Mapping[str, float]) -> F64:
        """The direction from the tip to the probe, unit vector, machine axes: a head turns it."""
        chain = self._chain({**self.axes(angles)})
        return np.asarray(chain.to_machine_axes(chain.orientation @ self._shaft)[0])

    def axes(self, angles: Mapping[str, float]) -> dict[str, float]:
        """Where the controller has all axes when the tip is in its middle, mm and rad."""
        given = {a: np.array([q]) for a, q in angles.items()}
        found = following(self._machine, given, self.point[None, :], self._offset[None, :])
        return {a: float(q[0]) for a, q in found.items()}

    def found(self, angles: Mapping[str, float], centre: F64, radius: float) -> StandingSphere:
        """The sphere where it was found."""
        point = self._measured(angles, centre)
        return StandingSphere(self._machine, self._offset, self._post, self._shaft, point, radius)

    def require_near(self, other: StandingSphere, placing: float) -> None:
        """Refuse a sphere that stands elsewhere.

        Raises
        ------
        AbbeError
            When it stands more than `placing` mm from another place.
        """
        away = float(np.linalg.norm(self.point - other.point))
        if away > placing:
            raise AbbeError(
                f"the sphere stands {away:.1f} mm off the plan, more than placing = {placing:g} mm"
            )

    def error(self, angles: Mapping[str, float], centre: F64) -> F64:
        """Actual − indicated, (3,), mm, machine axes: the sphere stays, the tip was at `centre`."""
        chain = self._chain(self._reached(angles, centre))
        return np.asarray(chain.to_machine_axes((self.point - chain.point[0])[None, :])[0])

    def _measured(self, angles: Mapping[str, float], centre: F64) -> F64:
        return np.asarray(self._chain(self._reached(angles, centre)).point[0])

    def _reached(self, angles: Mapping[str, float], centre: F64) -> dict[str, float]:
        place = self.axes(angles)
        return place | {a: float(centre[k] - self._offset[k]) for k, a in enumerate("XYZ")}

    def _chain(self, place: Mapping[str, float]) -> Chain:
        positions = {a: np.array([q]) for a, q in place.items()}
        return Chain(self._machine, Conditions(positions, tool=self._offset[None, :]))


def turning_axes(setup: PlannedSetup) -> tuple[str, ...]:
    """The rotary axes of a set-up that turn."""
    return tuple(a for a, q in setup.targets.items() if is_rotary(a) and float(np.ptp(q)) > 0.0)
