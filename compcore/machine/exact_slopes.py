"""Derivatives of the exact error by error motions, where they are not small."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.error_motion import INSTRUMENT, Component, ErrorMotion
from abbe.compcore.machine.kinematics import (
    Chain,
    conjugated,
    crossed,
    moved_along,
    moved_by,
    multiplied,
    rotation_xyz,
)

F64 = NDArray[np.float64]

_LINEAR: tuple[Component, ...] = ("X", "Y", "Z")


class ExactSlopes:
    """What a little more of an error motion does, errors composed with full rotations.

    With ``T_i`` the rotations of all places up to i and ``v_i`` the nominal vector from place i to
    the next, the exact error is ``Σ t_i + Σ (T_i − I)·v_i`` (`exact`), where t_i is turned by
    ``T_{i−1}`` at places that move along (`moved_along`). A turn ω more at place i turns all that
    follows: ``ω × (Σ_{m ≥ i} T_m·v_m + Σ_{m > i} T_{m−1}·t_m)``. For errors of 0 this is the lever
    rule.

    Parameters
    ----------
    chain
        The nominal chain at n rows.
    motions
        The error motions as they stand, each (n,), mm or rad.

    Attributes
    ----------
    orientation
        Of the tool relative to nominal, (n, 3, 3), as of `exact`.
    """

    def __init__(self, chain: Chain, motions: Mapping[ErrorMotion, F64]) -> None:
        self._chain = chain
        n = chain.conditions.n
        zero = np.zeros(n)
        places = chain.places
        self._angles: dict[str, tuple[F64, F64, F64]] = {}
        self._before: dict[str, F64] = {}
        self._beyond: dict[str, F64] = {}
        turned = np.broadcast_to(np.eye(3), (n, 3, 3))
        self._along = moved_along(chain.machine)
        moved: list[F64] = []
        carried: list[F64] = []
        for place, following in zip(places, (*places[1:], None), strict=True):
            a, b, c = (motions.get(ErrorMotion(place, k), zero) for k in ("A", "B", "C"))
            self._angles[place] = a, b, c
            self._before[place] = turned
            carried.append(zero[:, None])
            linear = [ErrorMotion(place, k) for k in _LINEAR]
            if place in self._along and any(m in motions for m in linear):
                own = np.stack([motions.get(m, zero) for m in linear], axis=1)
                carried[-1] = moved_by(turned, chain.in_machine_axes(place, own))
            if any(ErrorMotion(place, k) in motions for k in ("A", "B", "C")):
                turned = multiplied(turned, conjugated(chain, place, rotation_xyz(a, b, c)))
            reach = chain.lever(place)
            if following is not None:
                reach = reach - chain.lever(following)
            moved.append(moved_by(turned, reach))
        beyond = np.zeros((n, 3))
        for place, part, along in zip(
            reversed(places), reversed(moved), reversed(carried), strict=True
        ):
            beyond = beyond + part
            self._beyond[place] = beyond
            beyond = beyond + along
        self.orientation: F64 = turned
        self._trace: F64 = (turned[:, 0, 0] + turned[:, 1, 1] + turned[:, 2, 2])[:, None]

    def influence(self, error_motion: ErrorMotion) -> tuple[F64, F64]:
        """Translation and rotation of the tool per unit of an error motion, (n, 3) each.

        As `Chain.influence`; the rotation is that of the rotation vector's half skew part.
        """
        place = error_motion.place
        if not error_motion.rotation or place == INSTRUMENT or place not in self._before:
            moved, turned = self._chain.influence(error_motion)
            return (moved_by(self._before[place], moved) if place in self._along else moved), turned
        about = self._chain.in_machine_axes(place, self._axis(error_motion))
        about = moved_by(self._before[place], about)
        turned = 0.5 * (self._trace * about - moved_by(self.orientation, about))
        return crossed(about, self._beyond[place]), turned

    def _axis(self, error_motion: ErrorMotion) -> F64:
        """About what a rotation turns further, in its place's own axes, (n, 3): ``Rx·Ry·Rz``."""
        a, b, _ = self._angles[error_motion.place]
        one, none = np.ones_like(a), np.zeros_like(a)
        if error_motion.component == "A":
            parts = (one, none, none)
        elif error_motion.component == "B":
            parts = (none, np.cos(a), np.sin(a))
        else:
            parts = (np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b))
        return np.stack(parts, axis=1)
