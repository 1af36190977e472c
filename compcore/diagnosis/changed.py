"""What has changed: the least set of a fitted model's effects that a new campaign asks to move.

The model as it was given is the prior: its values with their covariance. With J the Jacobian, y
what the campaign measured beyond the given prediction and P the covariance, y is expected with
covariance ``I + J·P·Jᵀ`` (set-ups' nuisances projected out). Where it does not fit, one effect
after another is let go, as if nothing were known of its parameters: the one that explains most
first, until what is left agrees with what was known. What establishes a missing cause establishes
a change.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.diagnosis.screening.evidence import CONVINCING, INDISTINCT
from abbe.compcore.diagnosis.screening.left_out.independence import independent_share
from abbe.compcore.distributions import chi2_beyond
from abbe.compcore.effects import Scale, SensorOffset
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.design.unknowns import BASE_SCALE
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.days import day, fitted_days, measured_days
from abbe.compcore.model.late_thermometers import shrinks
from abbe.compcore.model.model import Model
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_AGREES = 1e-4
"""Chance above which a campaign agrees with what was known."""
_FREE = 30.0
"""Of its scale: how far an effect that is let go may be from where it was."""
_MOST = 6
_MATERIAL = 0.01
"""Least fall of χ² per independent observation that is worth a change."""
_WHOLE = 0.95
"""Part that one factor on all given values must explain of what letting every effect go explains:
a wrong unit or sign leaves nothing else, a machine that has moved does."""
_SUSPICIOUS = 0.5
"""A factor on all values that is further from 1 than this is suspicious."""
_ABSURD = 10.0
"""Where signals were recorded so many times their fitted range away, their unit is doubted."""


@dataclass(frozen=True)
class ChangedParameter:
    """One parameter of an effect that has changed.

    Attributes
    ----------
    name, unit
        As in the model file; unit inside the code.
    before, after, by, sd
        The given value, the new one, their difference and its standard deviation, in `unit`.
    extent
        Whether it is a place, a period or a path, which people read in mm.
    """

    name: str
    unit: str
    before: float
    after: float
    by: float
    sd: float
    extent: bool


@dataclass(frozen=True, eq=False)
class Change:
    """An effect of a fitted model whose values no longer hold.

    Attributes
    ----------
    effect
        The effect.
    parameters
        What changed, by how much.
    evidence
        In units of −2·ln(likelihood), after the price of its coefficients.
    p_value
        The chance of so large a fall of χ² without a change, times the number of effects tried.
    largest
        The greatest that it changes in a row of the campaign, beyond set-ups' zeros, mm or rad.
    of_rotations
        Whether that is rad.
    aliases
        Specs of other effects whose change would say the same.
    own
        The effect of the model that would have to move where `effect` is none of it.
    """

    effect: Effect
    parameters: tuple[ChangedParameter, ...]
    evidence: float
    p_value: float
    largest: float
    of_rotations: bool
    aliases: tuple[str, ...]
    own: Effect


@dataclass(frozen=True, eq=False)
class Standing:
    """Whether a model as it was given holds on a campaign.

    Attributes
    ----------
    chance
        Of so large a disagreement between what was known and the campaign.
    changes
        The least set of effects that have changed, the largest first; empty where the model holds.
    suspicions
        What is wrong with model or campaign as a whole: a sign, a unit; in words, said first.
    since
        Day (ISO 8601) on which the model held, where the campaign says that it is of a later one;
        else None.
    fitted
        Day on which the model was fitted, or None.
    else_holds
        Whether, with the changes, the rest of the model agrees with the campaign.
    variance
        What the variance of a row of the campaign counts for: more than 1 where more is left than
        is stated of the rows, or these are not independent.
    """

    chance: float
    changes: tuple[Change, ...]
    suspicions: tuple[str, ...]
    since: str | None
    fitted: str | None
    else_holds: bool = True
    variance: float = 1.0


def standing(given: Model, result: FitResult, beside: Sequence[F64] = ()) -> Standing | None:
    """Lay a campaign beside a model as it was given; None where nothing was known of its values.

    Parameters
    ----------
    given
        The model with values and covariance.
    result
        The same effects fitted to the campaign.
    beside
        Weighted columns (n, k) of causes that the campaign shows and the model lacks: what they
        explain is no change.
    """
    if given.covariance is None or not all(t.fitted for t in given.terms) or not given.terms:
        return None
    with threads_for(result.problem.n * result.problem.layout.size):
        known = _GivenValues(given, given.covariance, result, ())
        if not beside or known.disagrees(known.chi2(())) > _AGREES:
            # values that agree by themselves have not changed, whatever else was taken for them
            return _standing(known)
        return _standing(_GivenValues(given, given.covariance, result, beside))


class _GivenValues:
    """A campaign's normal equations about the given values, and what was known of them."""

    def __init__(
        self, given: Model, covariance: F64, result: FitResult, beside: Sequence[F64]
    ) -> None:
        problem = result.problem
        self.given, self.result, self.layout = given, result, problem.layout
        theta = problem.layout.of_model(given, problem.campaign)
        self.theta = theta
        eliminator = problem.eliminator(theta)
        nuisances = [c / np.maximum(np.linalg.norm(c, axis=0), 1e-300) for c in beside]
        columns = np.hstack([problem.columns(theta) * self.layout.scale, *nuisances])
        self._columns = eliminator.project(columns)
        self.y = eliminator.project(problem.residual(theta))
        self._predicted = eliminator.project(problem.campaign.value * problem.weight) - self.y
        free = self._columns @ np.linalg.lstsq(self._columns, self.y, rcond=1e-9)[0]
        left = self.y - free
        m, machine = self.layout.model_size, given.machine
        self.outside = list(_of_one_coefficient(given, problem.campaign))
        self._widths = np.array([e.linear(machine)[0].plausible[1] for e in self.outside])
        self._first_outside = self._columns.shape[1]
        if self.outside:
            beside_it = [problem.effect_columns(e, {}, theta) for e in self.outside]
            own = eliminator.project(np.hstack(beside_it) * self._widths)
            self._columns = np.hstack([self._columns, own])
        self.dof = max(1, problem.n - eliminator.rank - result.decomposition.rank)
        share = independent_share(left, problem.campaign.conditions)
        self.variance = max(1.0, float(left @ left) / self.dof) / share
        self.independent = max(2.0, share * problem.n)
        self.free = float(left @ left) / self.variance
        self.square = float(self.y @ self.y) / self.variance
        self._a = self._columns.T @ self._columns / self.variance
        self._b = self._columns.T @ self.y / self.variance
        scaled = covariance / np.outer(self.layout.scale[:m], self.layout.scale[:m])
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        half = vectors * np.sqrt(np.maximum(values, 0.0))
        size = self._a.shape[0]
        self._known = np.zeros((size, m + size - m))
        self._known[:m, :m] = half
        # base points and tools are placed anew, causes beside the model are free;
        # bodies begin where their warmth can be
        free = np.full(size - m, 1e3 / BASE_SCALE)
        free[size - m - len(self.outside) :] = 0.0
        expected = problem.prior_sd[m:] / self.layout.scale[m:]
        free[: len(expected)] = np.minimum(free[: len(expected)], expected)
        self._known[m:, m:] = np.diag(free)

    @property
    def terms(self) -> range:
        """The model's terms, and behind them what one coefficient outside it would say."""
        return range(len(self.given.terms) + len(self.outside))

    def is_outside(self, term: int) -> bool:
        """Whether it is none of the model's terms."""
        return term >= len(self.given.terms)

    def rarer(self, term: int) -> float:
        """What a term has to say more than those before it: the model's, thermometers, scales.

        A thermometer is exchanged, or comes loose; a scale hardly grows.
        """
        if not self.is_outside(term):
            return 0.0
        return (1.0 if self.effect(term).reads_model else 2.0) * INDISTINCT

    def effect(self, term: int) -> Effect:
        """The effect of a term."""
        n = len(self.given.terms)
        return self.outside[term - n] if self.is_outside(term) else self.given.effects[term]

    def where(self, term: int) -> slice:
        """Where a term's coefficients stand among the columns."""
        if not self.is_outside(term):
            return self.layout.terms[term]
        at = self._first_outside + term - len(self.given.terms)
        return slice(at, at + 1)

    def _half(self, let_go: Sequence[int]) -> F64:
        size = self._a.shape[0]
        more = []
        for term in let_go:
            where = self.where(term)
            own = np.zeros((size, where.stop - where.start))
            own[where] = (1.0 if self.is_outside(term) else _FREE) * np.eye(own.shape[1])
            more.append(own)
        return np.hstack([self._known, *more])

    def chi2(self, let_go: Sequence[int]) -> float:
        """χ² of the campaign beside what was known, nothing known of the effects let go."""
        half = self._half(let_go)
        inner = np.eye(half.shape[1]) + half.T @ self._a @ half
        moment = half.T @ self._b
        return self.square - float(moment @ np.linalg.solve(inner, moment))

    def moved(self, let_go: Sequence[int]) -> tuple[F64, F64]:
        """How far the parameters move, and standard deviations, (m,), in their units.

        Also those outside the model, where their columns stand.
        """
        half = self._half(let_go)
        inner = np.eye(half.shape[1]) + half.T @ self._a @ half
        spread = half @ np.linalg.solve(inner, half.T)
        scale = np.ones(len(spread))
        scale[: self.layout.model_size] = self.layout.scale[: self.layout.model_size]
        scale[self._first_outside :] = self._widths
        sd = np.sqrt(np.maximum(np.diag(spread), 0.0)) * scale
        return np.asarray(spread @ self._b * scale), sd

    def coefficients(self, term: int) -> int:
        """How many combinations of an effect's parameters the campaign shows."""
        where = self.where(term)
        return int((np.linalg.eigvalsh(self._a[where, where]) > 1.0).sum())

    def price(self, term: int) -> float:
        """What letting an effect go costs, in units of evidence."""
        return self.coefficients(term) * math.log(self.independent)

    def largest(self, term: int, moved: F64) -> tuple[float, bool]:
        """The greatest that an effect's change makes in a row, mm, or rad and True."""
        where = self.where(term)
        problem = self.result.problem
        outside = where.start - self._first_outside
        scale = self._widths[outside] if self.is_outside(term) else self.layout.scale[where]
        rows = self._columns[:, where] @ (moved[where] / scale)
        rows = np.where(problem.weight > 0.0, rows * problem.sd, 0.0)
        rotations = problem.campaign.kind == Kind.ROTATION
        lengths = np.abs(rows[~rotations])
        if lengths.size and float(lengths.max()) > 0.0:
            return float(lengths.max()), False
        return float(np.abs(rows[rotations]).max(initial=0.0)), True

    def disagrees(self, chi2: float) -> float:
        """The chance of so large a disagreement."""
        return chi2_beyond(max(0.0, chi2 - self.free), max(1, self.result.decomposition.rank))

    def factor(self) -> tuple[float, float]:
        """The factor on all given values that fits best, and how much that is of the best.

        The second is the fall of χ² by the factor, as part of its fall where nothing was known.
        """
        p = self._predicted
        square = float(p @ p)
        most = self.square - self.free
        if square <= 0.0 or most <= 0.0:
            return 1.0, 0.0
        by = float(p @ self.y) / square
        return 1.0 + by, by**2 * square / self.variance / most


def _dates(given: Model, campaign: Campaign) -> tuple[str | None, str | None]:
    """Day since which something can have changed, and day of the model's fit, where known.

    A model held when its own campaigns were measured; where they say no date, when it was fitted.
    Only a campaign that says that it is of a later day can have changed since.
    """
    fitted = day(given.fit.get("date"))
    held = max((d for d in fitted_days(given) if d is not None), default=fitted)
    measured = measured_days(campaign)
    if held is None or not measured or any(d is None or d < held for d in measured):
        return None, fitted
    return held, fitted


def _standing(known: _GivenValues) -> Standing:
    chi2 = known.chi2(())
    chance = known.disagrees(chi2)
    since, fitted = _dates(known.given, known.result.problem.campaign)
    suspicions = [*_units(known)]
    if chance > _AGREES:
        return Standing(chance, (), tuple(suspicions), since, fitted, variance=known.variance)
    factor, explains = known.factor()
    if explains > _WHOLE and abs(factor - 1.0) > _SUSPICIOUS:
        wrong = (_factor_words(factor), *suspicions)
        return Standing(chance, (), wrong, since, fitted, else_holds=False)
    found = _least_set(known, chi2)
    moved, sd = known.moved(found)
    changes = []
    for term in found:
        rest = [t for t in found if t != term]
        without, with_it = known.chi2(rest), known.chi2(found)
        price = known.price(term)
        by_chance = chi2_beyond(max(0.0, without - with_it), max(1, known.coefficients(term)))
        costs = {t: known.chi2([*rest, t]) + known.price(t) for t in known.terms if t not in found}
        swapped = [t for t, cost in costs.items() if cost - with_it - price < INDISTINCT]
        own = term
        if known.is_outside(term):
            own = min((t for t in costs if not known.is_outside(t)), key=lambda t: costs[t])
        changes.append(
            Change(
                known.effect(term),
                tuple(_parameters(known, term, moved, sd)),
                without - with_it - price,
                min(1.0, by_chance * len(known.terms)),
                *known.largest(term, moved),
                tuple(known.effect(t).spec for t in swapped),
                known.given.effects[own],
            )
        )
    changes.sort(key=lambda c: -c.evidence)
    suspicions += _impossible(known, changes)
    holds = known.disagrees(known.chi2(found)) > _AGREES
    wrong = tuple(suspicions)
    return Standing(chance, tuple(changes), wrong, since, fitted, holds, known.variance)


def _of_one_coefficient(given: Model, campaign: Campaign) -> Iterator[Effect]:
    """What a model has no effect for and one coefficient says: a thermometer, a longer scale.

    Thermometers that the model reads and the campaign recorded; scales of axes whose positioning is
    a shape.
    """
    effects = given.effects
    if not any(e.reads_model for e in effects):
        read = {s for e in effects for s in e.signals_needed()} & set(campaign.conditions.signals)
        for name in given.machine.signals:
            if name in read and given.machine.signals[name].temperature:
                yield SensorOffset(signal=name)
    scaled = {e.where()["axis"] for e in effects if e.kind == "scale"}
    for axis in given.machine.structure.linear:
        shaped = any(e.kind == "positioning" and e.where()["axis"] == axis for e in effects)
        if shaped and axis not in scaled:
            yield Scale(axis=axis)


def _parameters(known: _GivenValues, term: int, moved: F64, sd: F64) -> Iterator[ChangedParameter]:
    """How the parameters of a term have changed; of what is outside the model from 0."""
    where = known.where(term)
    if known.is_outside(term):
        (p,) = known.effect(term).linear(known.given.machine)
        by = float(moved[where.start])
        yield ChangedParameter(p.name, p.unit, 0.0, by, by, float(sd[where.start]), p.extent)
        return
    places = range(where.start, where.stop)
    for j, u in zip(places, known.layout.unknowns[where], strict=True):
        before, by = float(known.theta[j]), float(moved[j])
        yield ChangedParameter(u.name, u.unit, before, before + by, by, float(sd[j]), u.extent)


def _impossible(known: _GivenValues, changes: Sequence[Change]) -> Iterator[str]:
    """Of what would have become negative and never is, as an expansion is not.

    A thermometer that is read with the wrong sign, or exchanged with another one, shows so.
    """
    machine = known.given.machine
    for change in changes:
        signals = ", ".join(change.effect.signals_needed())
        for p in change.parameters:
            if shrinks(change.effect, machine, {p.name: (p.after, p.sd)}):
                yield (
                    f"{change.effect.spec}: {p.name} would be negative, which no material is. "
                    f"{signals} may be read with the wrong sign, or is exchanged with another "
                    "thermometer: look at it before anything is fitted"
                )


def _least_set(known: _GivenValues, chi2: float) -> list[int]:
    """The terms to let go, the one that explains most first; none that became superfluous."""
    found: list[int] = []
    while len(found) < _MOST and known.disagrees(chi2) < _AGREES:
        best: tuple[float, int, float] | None = None
        for term in known.terms:
            count = known.coefficients(term) if term not in found else 0
            if not count:
                continue
            after = known.chi2([*found, term])
            # before what the model has it has to say clearly more
            value = chi2 - after - known.price(term) - known.rarer(term)
            if best is None or value > best[0]:
                best = (value, term, after)
        if best is None or best[0] < CONVINCING:
            break
        if chi2 - best[2] < _MATERIAL * known.independent:
            break
        found.append(best[1])
        chi2 = best[2]
    found = _exchanged(known, found)
    for term in list(found):
        rest = [t for t in found if t != term]
        fall = known.chi2(rest) - known.chi2(found)
        if fall - known.price(term) < CONVINCING:
            found = rest
    return found


def _exchanged(known: _GivenValues, found: list[int]) -> list[int]:
    """The same number of terms; each in turn gives place to one that says more beside the others.

    What was let go first was chosen while the others were still held.
    """

    def paid(terms: Sequence[int]) -> float:
        return known.chi2(terms) + sum(known.price(t) + known.rarer(t) for t in terms)

    best = paid(found)
    for _ in range(_MOST):
        changed = False
        for term in found:
            rest = [t for t in found if t != term]
            others = [t for t in known.terms if t not in found]
            tried = [(paid([*rest, t]), t) for t in others if known.coefficients(t)]
            least = min(tried, default=(math.inf, -1))
            if least[0] < best - 1e-6:
                best, found, changed = least[0], [*rest, least[1]], True
        if not changed:
            break
    return found


def _factor_words(factor: float) -> str:
    if abs(factor + 1.0) < _SUSPICIOUS:
        return (
            "the campaign shows the opposite of what the model says, everywhere: a sign is wrong, "
            "of the measured values or of the model (error = actual − indicated)"
        )
    return (
        f"the campaign shows {in_digits(factor)} times what the model says, everywhere: look "
        "for a wrong unit of the measured values"
    )


def _units(known: _GivenValues) -> list[str]:
    """Signals that were recorded where no campaign of the fit came near."""
    said = []
    recorded = known.result.problem.campaign.conditions.signals
    machine = known.given.machine
    for name, (low, high) in known.given.measured_signals.items():
        if name not in recorded or name not in machine.signals:
            continue
        now = float(np.median(recorded[name]))
        wide = max(high - low, 1.0)
        if low - _ABSURD * wide <= now <= high + _ABSURD * wide:
            continue
        text = (
            f"{name} stands at {in_digits(now, 4)}, and was between {in_digits(low, 4)} and "
            f"{in_digits(high, 4)} when the model was fitted"
        )
        celsius = (now - 32.0) / 1.8
        if machine.signals[name].temperature:
            if low - 2.0 * wide <= celsius <= high + 2.0 * wide:
                text += ": it is recorded in °F"
            elif low - 2.0 * wide <= now - 273.15 <= high + 2.0 * wide:
                text += ": it is recorded in K"
        said.append(text)
    return said
