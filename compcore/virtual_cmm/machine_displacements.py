"""Displacements of touched points by a machine whose model is drawn from its covariance.

The effects' own `motions` are evaluated (`abbe.compcore.effects.base`), once for all draws where
nothing that they read is drawn, else at every draw's conditions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.corrected import positions_of
from abbe.compcore.effects.base import INSTRUMENT, Effect, Motion
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.model.inverse import invert_model
from abbe.compcore.model.model import Model, Term
from abbe.compcore.model.required_inputs import RequiredInputs
from abbe.compcore.model.sensitivity import covariance_root
from abbe.compcore.model.uncertainty import extrapolated
from abbe.compcore.virtual_cmm.causes import NOT_MEASURED, OUTSIDE, SENSORS
from abbe.compcore.virtual_cmm.drawn_inputs import DrawnInputs
from abbe.compcore.virtual_cmm.part_program import PartProgram
from abbe.compcore.virtual_cmm.requirements import known_covariance, require_stated

F64 = NDArray[np.float64]

_APPROACHED = 0.05
"""Component of a normal from which the approach moves an axis."""


@dataclass(frozen=True, eq=False)
class DrawnErrors:
    """Errors of the tip's centre, actual − indicated, in d draws at n points, mm.

    Attributes
    ----------
    true
        Of the drawn machine, shape (d, n, 3).
    applied
        What the correction takes it for, shape (d, n, 3) or (1, n, 3).
    parts
        Cause → its part of true − applied in the first draws, shape (≤ d, n, 3). Where effects are
        switched off, what they do is no part: it is a bias.
    """

    true: F64
    applied: F64
    parts: Mapping[str, F64]


class UnsureMachine:
    """A fitted model with its covariance, at the points of a part program.

    Parameters
    ----------
    model
        Fitted; switched effects belong to the machine, and are not corrected.
    program
        The part.

    Attributes
    ----------
    parameters
        How many the model has.
    covariance
        Of them, (p, p).
    middle
        The touched points' conditions in the middle of what is drawn.
    change
        How much what was not measured changes the error at most, (n, 3), mm; None: nothing is
        outside.
    beyond
        Positions, signals and tools of the program that were not measured.

    Raises
    ------
    InputError
        When the model has no covariance, or needs what the program does not state.
    """

    def __init__(self, model: Model, program: PartProgram) -> None:
        self.model, self.program = model, program
        self.applied = model.switched()
        self.parameters = sum(len(term.values) for term in model.terms)
        covariance = known_covariance(model, self.parameters)
        self.covariance = covariance
        self._root = covariance_root(covariance)
        self._sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        self._bare = replace(
            model, terms=tuple(t for t in model.terms if not _amends(t)), covariance=None
        )
        self._needs = RequiredInputs.of(model)
        require_stated(model, program, self._needs)
        self.middle = self._conditions()
        change, self.beyond = extrapolated(self.applied, self.middle)
        self.change = change if self.beyond else None
        self._own_parts = tuple(self._parts_of_terms())

    def _conditions(self) -> Conditions:
        """Where the machine stands, and how warm it is, in the middle of what is drawn."""
        program, machine = self.program, self.model.machine
        tips, tool = program.tips, program.offsets
        n = len(tips)
        positions = positions_of(machine, tips, tool, {})
        positions |= {a: np.full(n, q) for a, q in program.standing.items() if a not in "XYZ"}
        at = Conditions(
            positions,
            directions=self._directions(np.zeros((1, n, 3)))[0],
            tool=tool,
            time=np.full(n, program.time or 0.0),
            signals={name: np.full(n, s.value) for name, s in program.signals.items()},
        )
        # the tip's centre is there really; the machine believes to be elsewhere
        return invert_model(self.applied, at)[0]

    def _directions(self, sides: F64) -> tuple[dict[str, F64], bool]:
        """Approach directions of the axes on all rows, and whether any of them is drawn."""
        found, drawn = {}, False
        normals = self.program.normals
        for k, axis in enumerate("XYZ"):
            if axis not in self._needs.directions:
                continue
            moved = np.abs(normals[:, k]) > _APPROACHED
            drawn |= not bool(moved.all())
            own = np.where(moved, -np.sign(normals[:, k]), np.sign(sides[:, :, k]))
            found[axis] = own.reshape(-1)
        return found, drawn

    def _parts_of_terms(self) -> Iterator[tuple[str, Term, slice, F64]]:
        """Cause, term, where its parameters are, which of them belong to the cause (1 or 0)."""
        at = 0
        for term in self.model.terms:
            where = slice(at, at + len(term.values))
            at = where.stop
            if not term.fitted or not (self._sd[where] > 0.0).any():
                continue
            if term.effect.scope == "instrument" and not _amends(term):
                continue
            measured = np.array([v.measured for v in term.values.values()], dtype=np.float64)
            for name, mask in ((term.effect.spec, measured),
                               (term.effect.spec + NOT_MEASURED, 1.0 - measured)):  # fmt: skip
                if (self._sd[where] * mask > 0.0).any():
                    yield name, term, where, mask

    @property
    def causes(self) -> tuple[str, ...]:
        """The causes of `DrawnErrors.parts`, whatever is drawn."""
        names = [name for name, *_ in self._own_parts]
        if self.change is not None:
            names.append(OUTSIDE)
        if any(self.program.signals[s].sd > 0.0 for s in self._needs.signals):
            names.append(SENSORS)
        return tuple(names)

    def errors(self, drawn: DrawnInputs, kept: int) -> DrawnErrors:
        """Errors of the tip's centre in every draw; the parts of the first `kept` ones."""
        offsets = drawn.parameters @ self._root.T
        sensed = {s: self.program.signals[s] for s in self.program.signals}
        needed = [i for i, s in enumerate(sensed) if s in self._needs.signals]
        states = list(sensed.values())
        there = np.array([s.value for s in states]) + drawn.varied * [s.varies for s in states]
        read = there + drawn.sensors * [s.sd for s in states]
        moving = any(states[i].varies > 0.0 or states[i].sd > 0.0 for i in needed)
        directions, drawn_sides = self._directions(drawn.sides)
        shared = not moving and not drawn_sides
        at = self.middle if shared else self._tiled(there, directions)
        seen = at
        if any(states[i].sd > 0.0 for i in needed):
            seen = self._tiled(read, directions)
        parts = _Parts(kept)
        nominal = self._shaped(self.model.predict(at).translation)
        applied = self._shaped(self.applied.predict(seen).translation)
        if seen is not at:
            sensed_wrong = self._shaped(self.applied.predict(at).translation) - applied
            parts.kept[SENSORS] = sensed_wrong[:kept]
        amended = self._amended(at, offsets, parts)
        chain = Chain(self.model.machine, amended)
        for name, term, where, mask in self._own_parts:
            if not _amends(term):
                parts.add(name, self._part(term, chain, offsets[:, where] * mask))
        if self.change is not None:
            parts.add(OUTSIDE, drawn.outside[:, None, None] * self.change)
        true = nominal + parts.total
        ordered = {name: parts.kept[name] for name in self.causes}
        return DrawnErrors(true, applied, ordered)

    def _shaped(self, translation: F64) -> F64:
        """Rows of all draws, or of one for all, as (d or 1, n, 3)."""
        return translation.reshape(-1, len(self.program.points), 3)

    def _tiled(self, signals: F64, directions: Mapping[str, F64]) -> Conditions:
        """The points once for each draw, with its signals."""
        count, n = len(signals), len(self.program.points)

        def tiled(values: F64) -> F64:
            return np.tile(values, (count, *([1] * (values.ndim - 1))))

        middle = self.middle
        columns = {s: np.repeat(signals[:, i], n) for i, s in enumerate(self.program.signals)}
        own = {a: v if len(v) == count * n else tiled(v) for a, v in directions.items()}
        return Conditions(
            {a: tiled(q) for a, q in middle.positions.items()},
            directions=own,
            tool=tiled(middle.tool),
            time=tiled(middle.time),
            signals=columns,
        )

    def _amended(self, at: Conditions, offsets: F64, parts: _Parts) -> Conditions:
        """Readings as the drawn sensors' effects amend them; what each does joins the parts."""
        amended = self.model.amended(at)
        off = np.zeros_like(offsets)
        before: F64 | None = None
        for name, term, where, mask in self._own_parts:
            if not _amends(term):
                continue
            if before is None:
                before = self._shaped(self._bare.predict(amended).translation)
            off[:, where] += offsets[:, where] * mask
            amended = self._amended_by(at, off)
            after = self._shaped(self._bare.predict(amended).translation)
            parts.add(name, after - before)
            before = after
        return amended

    def _amended_by(self, at: Conditions, offsets: F64) -> Conditions:
        """All amending effects on the rows of every draw, with their parameters' offsets."""
        n, machine = len(self.program.points), self.model.machine
        rows = []
        for d, offset in enumerate(offsets):
            own, first = at if at.n == n else at.rows(slice(d * n, (d + 1) * n)), 0
            for term in self.model.terms:
                last = first + len(term.values)
                if _amends(term):
                    value = term.coefficients(machine)
                    off = offset[first : first + len(value)]
                    own = term.effect.amend(machine, own, value + off)
                first = last
            rows.append(own.signals)
        signals = {s: np.concatenate([row[s] for row in rows]) for s in at.signals}
        if at.n == n:
            blank = np.zeros((len(offsets), len(self.program.signals)))
            at = self._tiled(blank, {a: np.tile(v, len(offsets)) for a, v in at.directions.items()})
        return replace(at, signals=signals, _lags={}, _known=None, _made={})

    def _part(self, term: Term, chain: Chain, offsets: F64) -> F64:
        """What the offsets of a term's parameters do, (d, n, 3), mm."""
        machine, effect = self.model.machine, term.effect
        linear = len(effect.linear(machine))
        nonlinear = term.nonlinear(machine)
        if linear == offsets.shape[1] or not offsets[:, linear:].any():
            total = np.zeros((len(offsets), len(self.program.points), 3))
            for motion in _machine_motions(effect, chain.conditions, nonlinear, self.model):
                columns = motion.columns.reshape(-1, total.shape[1], motion.columns.shape[1])
                amount = np.einsum("dnk,dk->dn", np.broadcast_to(columns, (
                    len(offsets), *columns.shape[1:])), offsets[:, motion.parameters])  # fmt: skip
                moved = self._shaped(chain.influence(motion.error_motion)[0])
                total += amount[:, :, None] * moved
            return total
        return self._bent(term, chain, offsets)

    def _bent(self, term: Term, chain: Chain, offsets: F64) -> F64:
        """As `_part` where non-linear parameters are unsure: draw by draw."""
        machine, effect = self.model.machine, term.effect
        coefficients, nonlinear = term.coefficients(machine), term.nonlinear(machine)
        linear, n = len(coefficients), len(self.program.points)
        bounds = [p.bounds for p in effect.nonlinear(machine)]
        conditions = chain.conditions
        total = np.zeros((len(offsets), n, 3))
        for d, offset in enumerate(offsets):
            rows = slice(0, n) if conditions.n == n else slice(d * n, (d + 1) * n)
            at = conditions.rows(rows)
            values = {
                name: float(np.clip(value + offset[linear + j], *bounds[j]))
                for j, (name, value) in enumerate(nonlinear.items())
            }
            for sign, c, v in ((1.0, coefficients + offset[:linear], values),
                               (-1.0, coefficients, nonlinear)):  # fmt: skip
                for motion in _machine_motions(effect, at, v, self.model):
                    moved = chain.influence(motion.error_motion)[0][rows]
                    total[d] += sign * motion.amount(c)[:, None] * moved
        return total


class _Parts:
    """The sum of all causes, and what each of them does in the first draws."""

    def __init__(self, few: int) -> None:
        self.total: F64 = np.zeros((1, 1, 1))
        self.kept: dict[str, F64] = {}
        self._few = few

    def add(self, name: str, part: F64) -> None:
        self.total = self.total + part
        self.kept[name] = part[: self._few]


def _machine_motions(
    effect: Effect, conditions: Conditions, nonlinear: Mapping[str, float], model: Model
) -> list[Motion]:
    found = effect.motions(model.machine, conditions, nonlinear)
    return [m for m in found if m.error_motion.place != INSTRUMENT]


def _amends(term: Term) -> bool:
    """Whether it corrects readings, in place of moving the machine."""
    return term.fitted and type(term.effect).amend is not Effect.amend
