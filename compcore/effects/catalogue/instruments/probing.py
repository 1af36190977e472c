"""Effects of a probe that touches: its stylus bends, its trigger point differs all round."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import F64, Effect, Motion, Parameter
from abbe.compcore.effects.catalogue.instruments.setup import MEASURED
from abbe.compcore.effects.keys import Names
from abbe.compcore.effects.registry import register
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine

_STYLUS = 100.0
"""mm: length of a stylus for which its bend is stated."""

_LOBES = 3
"""Seats of a kinematic probe: three rollers on six balls."""


class ProbingEffect(Effect):
    """An effect on what a probe measures as it touches from all round."""

    scope = "instrument"
    reads_tool = True
    setups: Names

    @abstractmethod
    def touched(self, toward: F64, around: F64, length: F64) -> F64:
        """Columns of m touches, (m, k).

        Parameters
        ----------
        toward
            Measured directions, (m, 3): the components across the stylus, and the one along it.
        around
            Angle about the stylus, (m,) rad.
        length
            Of the tool, (m,) mm.
        """

    def rows(self, conditions: Conditions) -> NDArray[np.bool_]:
        """The rows that were touched, (n,)."""
        setups = conditions.setup_rows()
        mask = np.isin(setups.number, [setups.index.get(name, -1) for name in self.setups])
        if conditions.kind is not None:
            mask &= np.equal(conditions.kind, Kind.DISPLACEMENT)
        return np.asarray(mask)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """What the touches read too much, by their direction to the stylus."""
        rows = np.flatnonzero(self.rows(conditions))
        columns = np.zeros((conditions.n, len(self.linear(machine))))
        if rows.size and conditions.u is not None:
            u = conditions.u[rows]
            chain = Chain(machine, conditions.rows(rows))
            tool = chain.to_machine_axes(np.einsum("nij,nj->ni", chain.orientation, chain.tool))
            length = np.linalg.norm(tool, axis=1)
            toward = _across_and_along(u, tool, length)
            around = np.arctan2(toward[:, 1], toward[:, 0])
            columns[rows] = self.touched(toward, around, length)
        return (Motion(MEASURED, columns),)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None of the machine's: an instrument's effects are never folded."""
        return ()

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Self]:
        """All set-ups together that touch something small from all round: one probe."""
        touching = tuple(n for n, seen in coverage.setup_details.items() if seen.all_round)
        if touching:
            yield cls.model_validate({"setups": touching})


def _across_and_along(u: F64, tool: F64, length: F64) -> F64:
    """Directions in the stylus's own axes, (m, 3): two across it, and along it, away from its tip.

    The first lies as near to the machine's X as it can, of a stylus along X to Y.
    """
    along = np.where(length[:, None] > 0.0, -tool / np.maximum(length, 1e-9)[:, None], (0, 0, 1.0))
    near = np.where(np.abs(along[:, :1]) < 0.9, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    first = near - np.einsum("ni,ni->n", near, along)[:, None] * along
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(along, first)
    return np.stack([np.einsum("ni,ni->n", u, e) for e in (first, second, along)], axis=1)


@register
class StylusBending(ProbingEffect):
    """A probe's stylus bends as it touches across, the more the longer it is.

    Formula
        ``value = bend·(L/100 mm)³·sin²θ`` on touches of the set-ups; θ the angle between the
        measured direction and the stylus, L the length of the tool offset: a bar that is clamped at
        one end (`F·L³/3EI`, across it, of the force's part across it).
    Parameters
    ----------
        bend in mm, of a stylus of 100 mm, within ±20 µm: 0.1 N bend 100 mm of carbide of 4 mm by
        some 4 µm; what the probe's qualification takes out along is not seen.
    Signals
        None; the columns of the measured direction and of the tool offset.
    Typical causes
        Long or thin styli, extensions, a probe that was qualified with another stylus or from one
        side only, a measuring force set too high.
    Cure
        Qualify each stylus on the sphere from all round, shorter or stiffer styli, less force. It
        is the probe's, and never put right in the machine's tables.
    Source
        ISO 10360-5 (probing systems); beam theory.
    """

    kind = "stylus_bending"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The bend of 100 mm."""
        return (Parameter("bend", "mm", (-0.02, 0.02), "bend of a stylus of 100 mm"),)

    def touched(self, toward: F64, around: F64, length: F64) -> F64:
        """``(L/100)³·sin²θ``."""
        return ((length / _STYLUS) ** 3 * (toward[:, 0] ** 2 + toward[:, 1] ** 2))[:, None]


@register
class ProbeLobing(ProbingEffect):
    """A touch-trigger probe's pre-travel differs all round: three lobes of its three seats.

    Formula
        ``value = sin θ·(A·cos 3φ + B·sin 3φ) + C·sin²θ`` on touches of the set-ups; θ the angle
        between the measured direction and the stylus, φ the angle about the stylus from the
        machine's X (of a stylus along X from Y).
    Parameters
    ----------
        A, B, C in mm, within ±10 µm: 1 to 5 µm of kinematic touch-trigger probes, less than 0.5 of
        strain-gauge and scanning ones. C: from across it triggers later than from the tip.
    Signals
        None; the columns of the measured direction and of the tool offset.
    Typical causes
        Unequal lever of the three seats, worn contacts, a force or a stylus other than at the
        probe's qualification.
    Cure
        Qualify the probe in more directions, touch at one speed, exchange the module. It is the
        probe's, and never put right in the machine's tables.
    Source
        ISO 10360-5, ISO 230-10 (probing performance); Estler et al., Precision Engineering 19
        (1996), 68-82.
    """

    kind = "probe_lobing"

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """Three lobes, and what differs from pole to equator."""
        words = ("cosine of three lobes", "sine of three lobes", "across the stylus")
        return tuple(
            Parameter(name, "mm", (-0.01, 0.01), text)
            for name, text in zip("ABC", words, strict=True)
        )

    def touched(self, toward: F64, around: F64, length: F64) -> F64:
        """``sin θ·cos 3φ``, ``sin θ·sin 3φ``, ``sin²θ``."""
        sine = np.hypot(toward[:, 0], toward[:, 1])
        lobes = [sine * np.cos(_LOBES * around), sine * np.sin(_LOBES * around)]
        return np.stack([*lobes, sine**2], axis=1)
