"""Screening of all combinations of conventions to first order, before the exact ranking.

To first order the correction is a signed sum of columns, ``Σ s_j·d_j``, and linear in the
rotation point: ``Σ s_j·(d_j + Σ_b p_b·e_bj)``. With the columns' Gram matrices the residual of
every choice of signs, and the best rotation point for it, cost a few products of small vectors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention, levers
from abbe.compcore.maps.conventions.hypotheses import (
    Hypothesis,
    Point,
    lever_axes,
    named_points,
    own_travels,
    sign_choices,
    sign_rows,
    structures,
)
from abbe.compcore.maps.conventions.subject import Source, Subject
from abbe.compcore.maps.conventions.switched import SwitchedPoints

F64 = NDArray[np.float64]
Signs = frozenset[Source]

_KEPT, _KEPT_FREE = 30, 5
"""Hypotheses kept of each rotation point, and with an estimated one."""
_CLEAR = 12.0
"""Difference in χ² from which two hypotheses are told apart (p ≈ 5e-4 for one degree)."""


@dataclass(frozen=True, eq=False)
class ConventionFrame:
    """A choice of chain order, own travel and forms of squareness, with the map's columns there.

    Attributes
    ----------
    sources
        The columns' names.
    columns
        Shape (3n, sources), mm: what each column does at the points with the rotation point at
        zero (or where the machine declares it).
    moves
        Axis → shape (3n, sources), mm per mm: how that changes with the rotation point.
    """

    structure: Structure
    convention: Convention
    machine: Machine
    sources: list[Source]
    columns: F64
    moves: dict[str, F64]

    def at_point(self, point: Point) -> F64:
        """The same columns with another rotation point (mm)."""
        shifted = self.columns
        for axis, position in (point or {}).items():
            shifted = shifted + position * self.moves[axis]
        return shifted


def frames(
    subject: Subject, points: SwitchedPoints, stated: Structure, any_order: bool
) -> Iterator[ConventionFrame]:
    """Every choice of chain order, own travel and forms of squareness to be screened."""
    for structure in structures(stated, any_order):
        bare = subject.machine(structure)
        for own in own_travels(bare):
            for form, beside in subject.forms():
                convention = Convention(own_travel=own, squareness=form, stated=beside)
                yield frame(subject, points, structure, convention)


def frame(
    subject: Subject, points: SwitchedPoints, structure: Structure, convention: Convention
) -> ConventionFrame:
    """The columns of one such choice, mm; signs and rotation point stay open."""
    open_ = replace(convention, reversed=frozenset(), rotation_point={})
    machine = open_.on(subject.machine(structure))
    chain = Chain(machine, points.conditions)
    parts = subject.parts(machine, (convention.squareness, convention.stated), points.conditions)
    sources = list(dict.fromkeys(part.source for part in parts))
    columns = np.zeros((points.n, 3, len(sources)))
    moves = {a: np.zeros((points.n, 3, len(sources))) for a in lever_axes(machine)}
    for part in parts:
        j = sources.index(part.source)
        moved, turned = chain.influence(part.error_motion)
        columns[:, :, j] += moved * part.values[:, None]
        if part.error_motion.rotation and part.error_motion.place in machine.structure.linear:
            for axis in levers(machine, part.error_motion.place):
                along = np.asarray(machine.axis(axis).direction)
                # the rotation point is subtracted from the lever
                moves[axis][:, :, j] -= np.cross(turned, along) * part.values[:, None]
    flat = {a: m.reshape(-1, len(sources)) for a, m in moves.items()}
    return ConventionFrame(
        structure, open_, machine, sources, columns.reshape(-1, len(sources)), flat
    )


@dataclass(frozen=True)
class ScreenedHypothesis:
    """A hypothesis with its first-order sum of squared residuals, mm²."""

    hypothesis: Hypothesis
    rss: float


def screen(
    found: ConventionFrame, points: SwitchedPoints, *, declared: bool
) -> list[ScreenedHypothesis]:
    """The best hypotheses of a frame, with named and with an estimated rotation point."""
    unseen = unseen_columns(found, points)
    choices = _distinct(sign_choices(found.machine.structure.linear), found.sources, unseen)
    measured = points.difference.reshape(-1)
    artefact = (False,) if points.both_read else (False, True)
    results: list[ScreenedHypothesis] = []
    for point in named_points(found.machine, declared):
        columns = found.at_point(point)
        gains = _gain_signs(columns, measured, found.sources)
        more = _distinct([*choices, gains], found.sources, unseen)
        signs = sign_rows(more, found.sources)
        agreement = signs @ (columns.T @ measured)
        size = np.einsum("fi,ij,fj->f", signs, columns.T @ columns, signs)
        for opposite in artefact:
            sign = -1.0 if opposite else 1.0
            rss = measured @ measured - 2.0 * sign * agreement + size
            results += [
                ScreenedHypothesis(_hypothesis(found, more[i], point, opposite), float(rss[i]))
                for i in np.argsort(rss, kind="stable")[:_KEPT]
            ]
    every = np.hstack([found.columns, *found.moves.values()])
    more = [*choices, _gain_signs(every, measured, found.sources)]
    for opposite in artefact:
        value = -measured if opposite else measured
        free = _free_point(found, value, _distinct(more, found.sources, unseen))
        results += [
            ScreenedHypothesis(replace(_hypothesis(found, s, p, opposite), fitted_point=True), rss)
            for s, p, rss in free[:_KEPT_FREE]
        ]
    return results


def unseen_columns(found: ConventionFrame, points: SwitchedPoints) -> set[Source]:
    """Columns so small at these points that their sign cannot be seen."""
    noise = max(points.sigma, 1e-6)
    size = (2.0 * found.columns) ** 2
    small = size.sum(axis=0) < _CLEAR * noise**2
    return {s for s, is_small in zip(found.sources, small, strict=True) if is_small}


def _hypothesis(found: ConventionFrame, chosen: Signs, point: Point, artefact: bool) -> Hypothesis:
    convention = replace(found.convention, reversed=chosen, rotation_point=point)
    return Hypothesis(found.structure, convention, artefact)


def _distinct(choices: list[Signs], sources: list[Source], unseen: set[Source]) -> list[Signs]:
    """One of the choices that differ only in columns that are not there or not seen."""
    there = frozenset(s for s in sources if s not in unseen)
    kept: dict[Signs, Signs] = {}
    for chosen in choices:
        kept.setdefault(chosen & there, chosen)
    return list(kept.values())


def _gain_signs(columns: F64, measured: F64, sources: list[Source]) -> Signs:
    """Signs of the factors with which the columns fit the points best.

    Columns beyond the sources' own (what a rotation point adds) are fitted along.
    """
    gain = np.linalg.lstsq(columns, measured, rcond=1e-6)[0]
    return frozenset(s for s, g in zip(sources, gain, strict=False) if g < -0.5 and s[0])


def _free_point(
    found: ConventionFrame, measured: F64, choices: list[Signs]
) -> list[tuple[Signs, dict[str, float], float]]:
    """For every choice of signs the rotation point that fits best and what is left; best first."""
    axes = list(found.moves)
    if not axes:
        return []
    signs = sign_rows(choices, found.sources)
    left = measured - signs @ found.columns.T  # (choices, 3n)
    shifts = np.stack([signs @ found.moves[a].T for a in axes], axis=2)  # (choices, 3n, axes)
    normal = np.einsum("fka,fkb->fab", shifts, shifts)
    inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    point = np.einsum("fab,fkb,fk->fa", inverse, shifts, left)
    after = left - np.einsum("fka,fa->fk", shifts, point)
    rss = np.einsum("fk,fk->f", after, after)
    return [
        (choices[i], dict(zip(axes, point[i].tolist(), strict=True)), float(rss[i]))
        for i in np.argsort(rss, kind="stable")
    ]
