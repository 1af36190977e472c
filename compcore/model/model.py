"""A model: a machine plus effects with parameter values; what it predicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import INSTRUMENT, Effect, ErrorMotion
from abbe.compcore.errors import InputError, require_type
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, exact, first_order
from abbe.compcore.machine.machine import Machine
from abbe.compcore.notebook import html_table
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]
Composition = Literal["first-order", "exact"]
Switch = Literal["on", "off", "shown"]
"""Whether an effect's compensation is applied, left out, or computed and reported only."""


@dataclass(frozen=True, slots=True)
class Value:
    """A parameter's value and standard uncertainty, units inside the code; sd None: not fitted.

    `measured`: False where the campaigns that were fitted say nothing of it, by their design: it
    stands where it stood.
    """

    value: float
    sd: float | None = None
    measured: bool = True


@dataclass(frozen=True)
class Term:
    """One effect of a model with its parameter values (empty until fitted).

    Attributes
    ----------
    effect
        The effect.
    values
        The names of linear and non-linear parameters → `Value`.
    switch
        Whether its compensation is applied (ISO/TR 16907, 9.2.4 k). The effect belongs to the
        model either way: fit and comparison do not ask.
    tables
        For an effect that holds tables of its own (an error grid): those that are switched
        otherwise, by name.
    """

    effect: Effect
    values: Mapping[str, Value] = field(default_factory=dict)
    switch: Switch = "on"
    tables: Mapping[str, Switch] = field(default_factory=dict)

    @property
    def fitted(self) -> bool:
        """Whether the effect has its values; without, it predicts 0."""
        return bool(self.values) or self.effect.given

    @property
    def table_names(self) -> tuple[str, ...]:
        """Names of the effect's own tables; empty where it has none."""
        tables = getattr(self.effect, "tables", ())
        return tuple(dict.fromkeys(table.name for table in tables))

    def require_table(self, name: str) -> None:
        """Refuse a name that none of the effect's tables has.

        Raises
        ------
        InputError
            Lists those that there are.
        """
        known = self.table_names
        if name not in known:
            raise InputError(
                f"{self.effect.kind} has no such table",
                field="tables",
                found=name,
                expected="one of " + (", ".join(known) or "none: the effect is one compensation"),
            )

    def part(self, wanted: Switch) -> Term | None:
        """What of this term is switched so; None: nothing."""
        if not self.tables:
            return self if self.switch == wanted else None
        names = [n for n in self.table_names if self.tables.get(n, self.switch) == wanted]
        only = getattr(self.effect, "only", None)
        return replace(self, effect=only(names), tables={}) if names and only else None

    def coefficients(self, machine: Machine) -> F64:
        """The linear parameters in the order of the effect's columns, shape (p,)."""
        return np.array([self.values[p.name].value for p in self.effect.linear(machine)])

    def nonlinear(self, machine: Machine) -> dict[str, float]:
        """The non-linear parameters by name, in their units inside the code."""
        return {p.name: self.values[p.name].value for p in self.effect.nonlinear(machine)}


@dataclass(frozen=True)
class Prediction:
    """Predicted error at the functional point at n rows; error = actual − indicated, machine axes.

    Attributes
    ----------
    translation
        Error of the functional point, shape (n, 3), mm.
    rotation
        Error of the functional orientation, shape (n, 3), rad (small rotation vector).
    orientation
        Shape (n, 3, 3): columns are the directions of X, Y, Z at the tool.
    """

    translation: F64
    rotation: F64
    orientation: F64


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """A machine and the effects that make it err, with parameter values and covariance.

    Attributes
    ----------
    machine
        The machine.
    terms
        Effects with their values, in the file's order.
    composition
        ``first-order``: the lever rule, in which effects add up. ``exact``: full rotations, as
        compensation maps are applied; second-order differences (10 nm at 100 µrad and 1 m).
    fit
        Provenance of the values (the ``[fit]`` section), empty until fitted.
    history
        One record for each ancestor, oldest first.
    covariance
        Covariance of the fitted parameters in the order of `parameter_names`, or None.
    """

    machine: Machine
    terms: tuple[Term, ...] = ()
    composition: Composition = "first-order"
    fit: Mapping[str, Any] = field(default_factory=dict)
    history: tuple[Mapping[str, Any], ...] = ()
    covariance: F64 | None = None

    def __post_init__(self) -> None:
        seen: set[str] = set()
        for i, term in enumerate(self.terms):
            where = f"effects[{i}]"
            try:
                term.effect.check(self.machine)
            except InputError as error:
                name = f"{where}.{error.field}" if error.field else where
                raise InputError(
                    f"{term.effect.kind}: {error.problem}",
                    field=name,
                    found=error.found,
                    expected=error.expected,
                ) from None
            identity = f"{term.effect.kind} {term.effect.where()}"
            if identity in seen:
                raise InputError("the same effect twice", field=where, found=term.effect.spec)
            seen.add(identity)
            if term.fitted:
                self._check_values(term, where)

    def _check_values(self, term: Term, where: str) -> None:
        wanted = [p.name for p in term.effect.linear(self.machine)]
        wanted += [p.name for p in term.effect.nonlinear(self.machine)]
        for name in term.values:
            if name not in wanted:
                raise InputError(
                    f"{term.effect.kind} has no such parameter",
                    field=f"{where}.parameters.{name}",
                    found=name,
                    expected="one of " + ", ".join(wanted),
                )
        for name in wanted:
            if name not in term.values:
                raise InputError(
                    f"{term.effect.kind}: a parameter is missing",
                    field=f"{where}.parameters.{name}",
                    expected="all of " + ", ".join(wanted) + ", or none (not yet fitted)",
                )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Model):
            return NotImplemented
        alike = all(
            getattr(self, f.name) == getattr(other, f.name)
            for f in fields(self)
            if f.name != "covariance"
        )
        if self.covariance is None or other.covariance is None:
            return alike and self.covariance is other.covariance
        return alike and np.array_equal(self.covariance, other.covariance)

    def __repr__(self) -> str:
        return f"<Model: {self.summary()}>"

    @property
    def fitted_to(self) -> set[str]:
        """The SHA-256 of the campaigns to which the model was fitted."""
        return {str(record.get("sha256")) for record in self.fit.get("campaigns", ())}

    def seen(self, files: Iterable[str]) -> bool:
        """Whether the model was fitted to all files of a campaign, by their SHA-256."""
        wanted = set(files)
        return bool(wanted) and wanted <= self.fitted_to

    def summary(self) -> str:
        """The machine, its structure, how much of the model is fitted, in one line."""
        fitted = sum(len(term.values) for term in self.terms)
        name = f"{self.machine.name}, " if self.machine.name else ""
        text = f"{name}{self.machine.structure}, {len(self.terms)} effects"
        if not fitted:
            return f"{text}, not fitted"
        text += f" with {fitted} parameters"
        rms = self.fit.get("rms")
        return text if rms is None else f"{text}, {in_digits(rms)} µm rms left where it was fitted"

    def _repr_html_(self) -> str:
        rows = [[term.effect.spec, len(term.values) or None] for term in self.terms]
        return html_table(["effect", "parameters fitted"], rows, f"Model: {self.summary()}")

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects, without their values."""
        return tuple(term.effect for term in self.terms)

    def with_effects(self, *effects: Effect) -> Model:
        """This model with more effects, not yet fitted, at the end."""
        return replace(self, terms=(*self.terms, *(Term(effect) for effect in effects)))

    def with_values(self, values: Sequence[Mapping[str, Value]]) -> Model:
        """This model with new values, one mapping for each term."""
        terms = tuple(replace(term, values=v) for term, v in zip(self.terms, values, strict=True))
        return replace(self, terms=terms)

    @property
    def switches(self) -> dict[str, Switch]:
        """Every effect's switch by its spec; tables that differ by ``SPEC NAME``."""
        found: dict[str, Switch] = {}
        for term in self.terms:
            found[term.effect.spec] = term.switch
            found.update({f"{term.effect.spec} {name}": s for name, s in term.tables.items()})
        return found

    @property
    def of_their_day(self) -> tuple[str, ...]:
        """Specs of effects that hold on the day only to which they were fitted."""
        return tuple(t.effect.spec for t in self.terms if t.effect.of_its_day())

    def switched(self, wanted: Switch = "on") -> Model:
        """The part of this model whose compensation is on (or off, or only shown).

        What is applied by `abbe correct`, `table` and `run` is the part that is on, without what
        says nothing of another day (a drift, an event, a formula of the time): it would run again
        by another clock. Its covariance is that of the effects that are left.
        """
        gone = self.of_their_day if wanted == "on" else ()
        if not gone and not any(term.switch != wanted or term.tables for term in self.terms):
            return self
        kept: list[Term] = []
        rows: list[int] = []
        row = 0
        for term in self.terms:
            part = term.part(wanted)
            if part is not None and term.effect.spec not in gone:
                kept.append(part)
                rows += range(row, row + len(term.values))
            row += len(term.values)
        covariance = self.covariance
        if covariance is not None and len(covariance) == row:
            covariance = covariance[np.ix_(rows, rows)]
        return replace(self, terms=tuple(kept), covariance=covariance)

    def with_switch(self, name: str, switch: Switch, table: str = "") -> Model:
        """This model with one effect, or one table of an effect, switched.

        Parameters
        ----------
        name
            The effect's spec, or as much of its beginning as is unique.
        switch
            On, off or shown.
        table
            Name of one of its tables; empty: the whole effect.

        Raises
        ------
        InputError
            When no effect, or more than one, is called that, or it has no such table.
        """
        found = [i for i, t in enumerate(self.terms) if t.effect.spec == name]
        found = found or [i for i, t in enumerate(self.terms) if t.effect.spec.startswith(name)]
        if len(found) != 1:
            raise InputError(
                "no effect is called that" if not found else "more than one effect is called that",
                field="effect",
                found=name,
                expected="one of " + "; ".join(t.effect.spec for t in self.terms),
            )
        terms = list(self.terms)
        term = terms[found[0]]
        if not table:
            terms[found[0]] = replace(term, switch=switch, tables={})
        else:
            term.require_table(table)
            terms[found[0]] = replace(term, tables={**term.tables, table: switch})
        return replace(self, terms=tuple(terms))

    def signals_needed(self) -> tuple[str, ...]:
        """Signals that the fitted machine and workpiece effects read, in order of first use."""
        names: dict[str, None] = {}
        for term in self.terms:
            if term.fitted and term.effect.scope != "instrument":
                names.update(dict.fromkeys(term.effect.signals_needed()))
        return tuple(names)

    @property
    def measured_signals(self) -> Mapping[str, tuple[float, float]]:
        """Signal → where it ranged in the campaigns that were fitted, in its unit; may be empty."""
        ranges = self.fit.get("measured", {}).get("signals", {})
        return {name: (float(low), float(high)) for name, (low, high) in ranges.items()}

    @property
    def measured_differences(self) -> Mapping[tuple[str, str], tuple[float, float]]:
        """Two temperatures → how far the first was above the second in those campaigns, K."""
        ranges = self.fit.get("measured", {}).get("differences", {})
        return {
            (one, other): (float(low), float(high))
            for one, others in ranges.items()
            for other, (low, high) in others.items()
        }

    @property
    def measured_positions(self) -> Mapping[str, tuple[float, float]]:
        """Axis → where it stood in the campaigns that were fitted, mm (rotary: degrees)."""
        ranges = self.fit.get("measured", {}).get("positions", {})
        return {name: (float(low), float(high)) for name, (low, high) in ranges.items()}

    @property
    def measured_tool(self) -> tuple[tuple[float, float], ...]:
        """Range of the tool's offset x, y, z in the fitted campaigns, mm; empty where unknown."""
        ranges = self.fit.get("measured", {}).get("tool", [])
        return tuple((float(low), float(high)) for low, high in ranges)

    @cached_property
    def _acting(self) -> tuple[_Acting, ...]:
        """What makes the machine err: the instrument's effects, and unfitted ones, left out."""
        return tuple(
            _Acting(t.effect, t.coefficients(self.machine), t.nonlinear(self.machine))
            for t in self.terms
            if t.effect.scope != "instrument" and t.fitted
        )

    def amended(self, conditions: Conditions) -> Conditions:
        """Conditions with sensor readings corrected by the fitted effects (`sensor_offset`).

        A sensor's offset, for one, is taken off its readings.
        """
        for effect, coefficients in self._amending:
            conditions = effect.amend(self.machine, conditions, coefficients)
        return conditions

    @cached_property
    def _amending(self) -> tuple[tuple[Effect, F64], ...]:
        """Fitted effects that correct readings, with their linear parameters."""
        return tuple(
            (t.effect, t.coefficients(self.machine))
            for t in self.terms
            if t.fitted and type(t.effect).amend is not Effect.amend
        )

    def error_motions(self, conditions: Conditions) -> dict[ErrorMotion, F64]:
        """Every error motion that the fitted effects move, summed over effects, each (n,).

        Effects of the instrument are not the machine's and are left out; readings are amended.
        """
        conditions = self.amended(conditions)
        sums: dict[ErrorMotion, F64] = {}
        for acting in self._acting:
            for error_motion, value in acting.motions(self.machine, conditions):
                sums[error_motion] = sums[error_motion] + value if error_motion in sums else value
        return sums

    def predict(self, conditions: Conditions) -> Prediction:
        """The error at the functional point at n rows of conditions, by the model's composition."""
        require_type(conditions, Conditions, "conditions")
        return self._predict(Chain(self.machine, conditions))

    def _predict(self, chain: Chain) -> Prediction:
        motions = self.error_motions(chain.conditions)
        if self.composition == "exact":
            translation, orientation = exact(chain, motions)
            skew = orientation - np.swapaxes(orientation, 1, 2)
            rotation = 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
            return Prediction(translation, rotation, orientation)
        translation, rotation = first_order(chain, motions)
        return Prediction(translation, rotation, _small_rotation(rotation))

    def axis_error(self, conditions: Conditions) -> dict[str, F64]:
        """The error at the functional point as equivalent moves of X, Y and Z, each (n,), mm.

        On a machine whose linear axes stand square to the bed these are the components of the
        error; where rotary axes carry linear ones, the components along those axes as they stand.
        The move of an axis that the machine does not have is 0 (`Chain.left_by_moves`).
        """
        chain = Chain(self.machine, conditions)
        along = chain.as_moves(self._predict(chain).translation)
        return {axis: along[:, k] for k, axis in enumerate("XYZ")}

    def contributions(self, conditions: Conditions) -> dict[str, F64]:
        """Each fitted effect's part of the first-order error: spec → (n, 3), mm.

        The parts sum to the first-order translation error.
        """
        return {spec: moved for spec, (moved, _) in self.parts(conditions).items()}

    def parts(self, conditions: Conditions) -> dict[str, tuple[F64, F64]]:
        """Each fitted effect's part of the first-order error: spec → (n, 3), mm; (n, 3), rad."""
        conditions = self.amended(conditions)
        chain = Chain(self.machine, conditions)
        parts: dict[str, tuple[F64, F64]] = {}
        for acting in self._acting:
            moved, turned = np.zeros((conditions.n, 3)), np.zeros((conditions.n, 3))
            for error_motion, value in acting.motions(self.machine, conditions):
                by, about = chain.influence(error_motion)
                moved += by * value[:, None]
                if error_motion.rotation:
                    turned += about * value[:, None]
            parts[acting.effect.spec] = moved, turned
        return parts


@dataclass(frozen=True, eq=False)
class _Acting:
    """A fitted effect of machine or workpiece, its parameters in the order of its columns."""

    effect: Effect
    coefficients: F64
    nonlinear: Mapping[str, float]

    def motions(self, machine: Machine, conditions: Conditions) -> list[tuple[ErrorMotion, F64]]:
        """Its error motions on n rows: (error motion, (n,) mm or rad)."""
        return [
            (motion.error_motion, motion.amount(self.coefficients))
            for motion in self.effect.motions(machine, conditions, self.nonlinear)
            if motion.error_motion.place != INSTRUMENT
        ]


def _small_rotation(rotation: F64) -> F64:
    """``I + [ω]×`` for small rotation vectors (n, 3) rad → (n, 3, 3)."""
    matrix = np.tile(np.eye(3), (rotation.shape[0], 1, 1))
    a, b, c = rotation.T
    matrix[:, 0, 1], matrix[:, 0, 2] = -c, b
    matrix[:, 1, 0], matrix[:, 1, 2] = c, -a
    matrix[:, 2, 0], matrix[:, 2, 1] = -b, a
    return matrix
