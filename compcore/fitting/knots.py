"""Knots that are found: how many a ``spline:auto`` gets, and where, by evidence.

Krulewich closed with the form of the polynomials as what limits a fit, and splines with knots where
they are needed as the way on. Every cubic spline with knots on a fine raster lies within the spline
on the whole raster, so one fit on the raster says what all others would leave. Knots are added
where they take most off χ², taken out where they take least, and moved, until no step pays any
more. What pays is Akaike's criterion, corrected for few rows: χ² plus twice the number of unknowns.
A knot counts as four, its coefficient and three for having been picked among many places (Friedman,
Multivariate adaptive regression splines, 1991). χ² is counted in units of what the finest splines
leave, so uncertainties that are stated too large or too small make no knots.

How sure the choice is: all sets that differ from it by one knot (more, fewer, elsewhere) have the
weight ``exp(−Δ/2)``, Δ their difference in the criterion. And because knots that were picked for
their fit make a model look surer than it is, the covariance is that of a wider one (`widened`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.shapes import AUTO, CUBIC, Shape
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.determinacy import LEAST_INFORMATION
from abbe.compcore.fitting.reduction import triangle
from abbe.compcore.linalg import svd
from abbe.compcore.machine.machine import Axis
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model, Term, Value

F64 = NDArray[np.float64]

_PARTS = (12, 30)
"""Least and greatest number of parts of the raster."""
_COLUMNS = 600
"""About so many coefficients of the raster in all."""
_LOOKS_BEYOND = 2.0
"""Knots are still added, to be tried, while they take so much off χ² (noise: 1)."""
_MOST = 8
"""Knots of an effect, on average, at which adding ends."""
_UNKNOWNS = 4
"""As many unknowns a knot counts."""
_END, _APART = 0.134, 0.1
"""Part of the travel from its end to a knot, and between two knots, at least: what is measured
there says little of so short a piece, and a cubic would run away."""
_FEWEST = 6
"""Knots at equal distances, at least, of the wider fit that says how sure the curves are."""
_SWEEPS = 6
_SEEN = 1e-3
"""Weight, relative to the best, from which another choice counts."""
_LEAST_DOF = 10
_ROUNDING = 1e-8
_GRID = 121


@dataclass(frozen=True, slots=True)
class KnotChoice:
    """The knots that one effect got.

    Attributes
    ----------
    effect
        Its name without them: ``positioning axis=X shape=spline:auto``.
    axis
        The axis along which they stand.
    knots, spread
        Their places, and the standard deviation of each, mm (rotary: degrees).
    probability
        Number of knots → its share of the evidence, among the sets that were compared.
    curve_sd
        How far other choices would move the curve, standard deviation at its worst place, in the
        coefficients' unit; a straight line, which other effects hold, left out.
    unit
        That unit, inside the code (mm, rad, mm/kg, …).
    """

    effect: str
    axis: str
    knots: tuple[float, ...]
    spread: tuple[float, ...]
    probability: Mapping[int, float]
    curve_sd: float
    unit: str

    @property
    def where(self) -> str:
        """Unit of the places."""
        return "deg" if is_rotary(self.axis) else "mm"


def finds_knots(effect: Effect) -> bool:
    """Whether a fit is to find an effect's knots."""
    return getattr(effect, "shape", None) == AUTO


def on_raster(model: Model) -> Model:
    """The model with the finest splines in the place of those whose knots are to be found."""
    count = sum(map(finds_knots, model.effects))
    parts = int(np.clip(_COLUMNS // max(count, 1) - CUBIC, *_PARTS))
    shape = {"shape": f"spline:{parts + CUBIC}", "positions": ()}
    terms = tuple(
        Term(t.effect.model_copy(update=shape)) if finds_knots(t.effect) else t for t in model.terms
    )
    return replace(model, terms=terms, covariance=None)


def with_knots(
    model: Model, problem: Problem, theta: F64, chi2: float, dof: int
) -> tuple[Model, Model, tuple[KnotChoice, ...]]:
    """The model with the knots that the evidence is for, a wider one (`widened`), what to tell.

    Parameters
    ----------
    model
        With effects of shape ``spline:auto``.
    problem, theta
        The fit of `on_raster` of it.
    chi2, dof
        What that leaves, and its degrees of freedom.
    """
    search = _Search.of(model, problem, theta, chi2, dof)
    chosen = search.best()
    found = search.model(model, chosen)
    choices = (
        search.choice_of(e, chosen, found.effects[c.term]) for e, c in enumerate(search.curves)
    )
    return found, search.evenly(model, max(_FEWEST, *map(len, chosen))), tuple(choices)


@dataclass(frozen=True)
class _Curve:
    """An effect on the raster: its cubic, and a column for each place of a knot.

    Attributes
    ----------
    term
        Its index in the model.
    axis
        Along which it runs.
    places
        Inner places of the raster, (J,), mm or degrees as a model file has them.
    cubic, powers
        Coefficients on the raster of a cubic's four functions, (parts + 3, 4), and of the cubic
        beyond each place, (parts + 3, J).
    unit, scale
        Of its coefficients inside the code; a believable size of one.
    """

    term: int
    axis: Axis
    places: F64
    cubic: F64
    powers: F64
    unit: str
    scale: float

    @classmethod
    def of(cls, term: int, fine: Effect, axis: Axis, unit: str, scale: float) -> _Curve:
        shape = Shape.parse(str(getattr(fine, "shape", "")))
        parts = shape.order - CUBIC
        x = np.linspace(-1.0, 1.0, 8 * parts + 1)
        q = axis.middle + axis.half_travel * x
        raster = shape.basis(q, axis)
        inner = np.arange(1, parts) / parts
        places = axis.travel[0] + 2.0 * axis.half_travel * inner
        part = 0.5 * (x + 1.0)[:, None]
        powers = np.clip((part - inner) / (1.0 - inner), 0.0, None) ** 3
        wanted = np.column_stack([legendre.legvander(x, CUBIC), powers])
        found = np.asarray(np.linalg.lstsq(raster, wanted, rcond=None)[0], dtype=np.float64)
        shown = np.degrees(places) if axis.rotary else places
        cubic, beyond = found[:, : CUBIC + 1], found[:, CUBIC + 1 :]
        return cls(term, axis, np.round(shown, 3), cubic, beyond, unit, scale)


_Set = tuple[tuple[int, ...], ...]
"""For each curve the places of its knots, ascending."""


class _Search:
    """The evidence of every set of knots, from the triangular factor of the fit on the raster.

    Parameters
    ----------
    curves
        Effects on the raster.
    columns
        (k, E·J): what each knot does, in units of the noise, without what the rest can imitate.
    left
        (k,): what is left without any knot, in the same units.
    rows, beside
        Number of rows, set-ups' unknowns taken off, and of other unknowns that they determine.
    back
        From the knots' coefficients, (E·J,), to the coefficients of each curve's cubic, (E, 4).
    """

    def __init__(
        self, curves: Sequence[_Curve], columns: F64, left: F64, rows: int, beside: int,
        back: tuple[F64, F64],
    ) -> None:  # fmt: skip
        self.curves = curves
        self.columns = columns
        self.left = left
        self.rows = rows
        self.beside = beside
        self.back = back
        counts = [len(c.places) for c in curves]
        self.first = np.concatenate([[0], np.cumsum(counts)])
        self.curve_of = np.repeat(np.arange(len(curves)), counts)
        self.size = np.einsum("ij,ij->j", columns, columns)

    @classmethod
    def of(cls, model: Model, problem: Problem, theta: F64, chi2: float, dof: int) -> _Search:
        """From the fit on the raster."""
        layout, machine = problem.layout, model.machine
        m = layout.size
        reduced = triangle(problem, theta)
        factor, left = reduced[:m, :m], reduced[:m, m]
        noise = np.sqrt(chi2 / dof) if dof >= _LEAST_DOF and chi2 > 0.0 else 1.0
        target = (factor @ theta + left) / noise
        curves, rest = [], np.ones(m, dtype=np.bool_)
        for i, effect in enumerate(model.effects):
            if finds_knots(effect):
                where = layout.linear_of(i)
                unknown = layout.unknowns[where.start]
                fine = problem.model.effects[i]
                axis = machine.axis(str(getattr(effect, "axis", "")))
                curves.append(_Curve.of(i, fine, axis, unknown.unit, unknown.scale))
                rest[where] = False
        factor = factor / noise
        cubic = [factor[:, layout.linear_of(c.term)] @ c.cubic * c.scale for c in curves]
        base = np.column_stack([factor[:, rest] * layout.scale[rest], *cubic])
        powers = np.column_stack(
            [factor[:, layout.linear_of(c.term)] @ c.powers * c.scale for c in curves]
        )
        u, s, vt = svd(base)
        rank = int((s > LEAST_INFORMATION).sum())
        u, back = u[:, :rank], vt[:rank].T / s[:rank]
        beside = u.T @ powers
        whole = np.column_stack([powers - u @ beside, target - u @ (u.T @ target)])
        small = _triangle(whole)
        own = back[-(CUBIC + 1) * len(curves) :]
        rows = int((problem.weight > 0.0).sum()) - problem.eliminator(theta).rank
        return cls(
            curves, small[:, :-1], small[:, -1], rows, rank, (own @ (u.T @ target), own @ beside)
        )

    # ------------------------------------------------------------------ evidence

    def cost(self, knots: int) -> float:
        """What so many knots cost, in units of χ²: all unknowns, corrected for few rows."""
        unknowns = self.beside + _UNKNOWNS * knots
        spare = self.rows - unknowns - 1
        few = unknowns * (unknowns + 1) / spare if spare > 0 else np.inf
        return 2.0 * (unknowns + few)

    def indices(self, chosen: _Set) -> list[int]:
        """Columns of a set."""
        return [int(self.first[e]) + j for e, own in enumerate(chosen) for j in own]

    def score(self, chosen: _Set) -> float:
        """χ² and cost of a set: less is better."""
        left, _ = self._without(self.indices(chosen), np.zeros(0, dtype=np.int64))
        return float(left @ left) + self.cost(sum(map(len, chosen)))

    def _without(self, used: Sequence[int], asked: NDArray[np.int64]) -> tuple[F64, F64]:
        """What is left, and of some columns what is left of them, beside a set."""
        left, columns = self.left, self.columns[:, asked]
        if used:
            q = np.linalg.qr(self.columns[:, list(used)])[0]
            left = left - q @ (q.T @ left)
            columns = columns - q @ (q.T @ columns)
        return left, columns

    def gains(self, chosen: _Set, curve: int | None = None) -> F64:
        """By how much χ² falls with each further knot, of one curve or of all; −1: not seen."""
        own = slice(None) if curve is None else slice(self.first[curve], self.first[curve + 1])
        asked = np.arange(self.columns.shape[1])[own]
        left, columns = self._without(self.indices(chosen), asked)
        gains = self._gains_of(left, columns, self.size[asked])
        gains[self._barred(chosen)[own]] = -1.0
        return gains

    @staticmethod
    def _gains_of(left: F64, columns: F64, size: F64) -> F64:
        own = np.einsum("ij,ij->j", columns, columns)
        seen = own > np.maximum(LEAST_INFORMATION, _ROUNDING * size)
        return np.where(seen, (columns.T @ left) ** 2 / np.where(seen, own, 1.0), -1.0)

    def _barred(self, chosen: _Set) -> NDArray[np.bool_]:
        """Columns of places that are too near to a knot of a set, or to an end of the travel."""
        barred = np.zeros(self.columns.shape[1], dtype=np.bool_)
        for e, own in enumerate(chosen):
            first, last = int(self.first[e]), int(self.first[e + 1])
            parts = last - first + 1
            end, apart = round(_END * parts), round(_APART * parts)
            barred[first : first + end - 1] = barred[last - end + 1 : last] = True
            for j in own:
                barred[max(first + j - apart + 1, first) : min(first + j + apart, last)] = True
        return barred

    def losses(self, chosen: _Set) -> F64:
        """By how much χ² rises without each knot of a set, in the order of `indices`."""
        used = self.indices(chosen)
        whole = _triangle(np.column_stack([self.columns[:, used], self.left]))
        return _losses(whole, list(range(len(used))))

    # ------------------------------------------------------------------ search

    def model(self, model: Model, chosen: _Set) -> Model:
        """A model with the knots of a set."""
        terms = list(model.terms)
        for curve, own in zip(self.curves, chosen, strict=True):
            knots = tuple(float(curve.places[j]) for j in own)
            terms[curve.term] = _moved(model.terms[curve.term], knots, curve)
        return replace(model, terms=tuple(terms), covariance=None)

    def evenly(self, model: Model, count: int) -> Model:
        """A model with so many knots for each curve at equal distances, or about so."""
        chosen = []
        for curve in self.curves:
            places = np.arange(1, count + 1) * (len(curve.places) + 1) / (count + 1)
            chosen.append(tuple(int(j) - 1 for j in np.unique(np.rint(places))))
        return self.model(model, tuple(chosen))

    def best(self) -> _Set:
        """The set that the evidence is for: grown, thinned, moved."""
        chosen = self._thinned(self.grown(tuple(() for _ in self.curves)))
        for _ in range(_SWEEPS):
            before = self.score(chosen)
            chosen = self._thinned(self._settled(chosen))
            grown = self._thinned(self.grown(chosen))
            if self.score(grown) < self.score(chosen):
                chosen = grown
            if self.score(chosen) > before - 1e-6:
                break
        return chosen

    def grown(self, chosen: _Set) -> _Set:
        """Knots added one by one, beyond what pays, so that pairs are found too."""
        used = self.indices(chosen)
        left, columns = self._without(used, np.arange(self.columns.shape[1]))
        for _ in range(_MOST * len(self.curves) - len(used)):
            gains = self._gains_of(left, columns, self.size)
            gains[self._barred(chosen)] = -1.0
            at = int(gains.argmax())
            if gains[at] < _LOOKS_BEYOND:
                break
            chosen = self._with(chosen, at)
            q = columns[:, at] / np.linalg.norm(columns[:, at])
            left = left - q * float(q @ left)
            columns = columns - np.outer(q, q @ columns)
        return chosen

    def _with(self, chosen: _Set, column: int) -> _Set:
        e = int(self.curve_of[column])
        own = tuple(sorted((*chosen[e], column - int(self.first[e]))))
        return (*chosen[:e], own, *chosen[e + 1 :])

    def _less(self, chosen: _Set, column: int) -> _Set:
        e, j = int(self.curve_of[column]), column - int(self.first[self.curve_of[column]])
        own = tuple(i for i in chosen[e] if i != j)
        return (*chosen[:e], own, *chosen[e + 1 :])

    def _thinned(self, chosen: _Set) -> _Set:
        """The best set on the way down, the least useful knot taken out each time."""
        used = self.indices(chosen)
        whole = _triangle(np.column_stack([self.columns[:, used], self.left]))
        kept = list(range(len(used)))
        best, least, chi2 = chosen, self.cost(len(kept)), 0.0
        while kept:
            losses = _losses(whole, kept)
            i = int(losses.argmin())
            chi2 += float(losses[i])
            chosen = self._less(chosen, used[kept.pop(i)])
            if chi2 + self.cost(len(kept)) < least:
                best, least = chosen, chi2 + self.cost(len(kept))
        return best

    def _settled(self, chosen: _Set) -> _Set:
        """Every knot at the best place that the others leave it."""
        for column in self.indices(chosen):
            e = int(self.curve_of[column])
            without = self._less(chosen, column)
            gains = self.gains(without, e)
            chosen = self._with(without, int(self.first[e]) + int(gains.argmax()))
        return chosen

    # ------------------------------------------------------------------ how sure

    def choice_of(self, e: int, chosen: _Set, effect: Effect) -> KnotChoice:
        """One curve's knots, with how sure they are."""
        curve = self.curves[e]
        own, count = chosen[e], sum(map(len, chosen))
        more, fewer = (self.cost(count + by) - self.cost(count) for by in (1, -1))
        others: list[tuple[float, _Set]] = []
        if any(chosen):
            for column, loss in zip(self.indices(chosen), self.losses(chosen), strict=True):
                if self.curve_of[column] == e:
                    others.append((loss + fewer, self._less(chosen, column)))
        for j, gain in enumerate(self.gains(chosen, e)):
            if gain >= 0.0:
                others.append((more - gain, self._with(chosen, int(self.first[e]) + j)))
        step = float(curve.places[1] - curve.places[0])
        spread = []
        for i, j in enumerate(own):
            without = self._less(chosen, int(self.first[e]) + j)
            gains = self.gains(without, e)
            low = own[i - 1] + 1 if i else 0
            high = own[i + 1] if i + 1 < len(own) else len(curve.places)
            between = np.arange(low, high)
            between = between[(gains[between] >= 0.0) | (between == j)]
            delta = gains[j] - gains[between]
            weight = np.exp(-0.5 * np.clip(delta, 0.0, 1e3))
            off = between - j
            spread.append(step * float(np.sqrt((weight * off**2).sum() / weight.sum() + 1.0 / 12)))
            others += [
                (float(d), self._with(without, int(self.first[e]) + int(b)))
                for b, d in zip(between, delta, strict=True)
                if b != j
            ]
        weighed = [(0.0, chosen), *others]
        weights = np.array([np.exp(-0.5 * max(min(d, 1e3), -1e2)) for d, _ in weighed])
        numbers = np.array([len(s[e]) for _, s in weighed])
        share = {int(k): float(weights[numbers == k].sum() / weights.sum()) for k in set(numbers)}
        share_of, apart = self._apart(e, weighed, weights)
        bare = effect.model_copy(update={"positions": ()})
        return KnotChoice(
            bare.spec,
            curve.axis.name,
            tuple(float(curve.places[j]) for j in own),
            tuple(spread),
            dict(sorted(share.items(), key=lambda item: -item[1])),
            float(np.sqrt((share_of @ apart**2).max())),
            curve.unit,
        )

    def _apart(
        self, e: int, weighed: Sequence[tuple[float, _Set]], weights: F64
    ) -> tuple[F64, F64]:
        """How far a curve lies from the chosen one in the sets that were compared.

        Returns
        -------
        share, apart
            Weight of each set that counts, (sets,), and its curve less the chosen one, a straight
            line left out, (sets, grid).
        """
        kept = weights > _SEEN * weights.max()
        curves = np.array([self._curve(e, s) for (_, s), k in zip(weighed, kept, strict=True) if k])
        x = np.linspace(-1.0, 1.0, _GRID)
        line = np.column_stack([np.ones(_GRID), x])
        apart = curves - curves[0]
        apart = apart - (line @ np.linalg.lstsq(line, apart.T, rcond=None)[0]).T
        return weights[kept] / weights[kept].sum(), apart

    def _curve(self, e: int, chosen: _Set) -> F64:
        """The curve of a set, (grid,), in its unit."""
        used = self.indices(chosen)
        values = np.zeros(self.columns.shape[1])
        if used:
            values[used] = np.linalg.lstsq(self.columns[:, used], self.left, rcond=None)[0]
        all_cubics, beside = self.back
        cubic = (all_cubics - beside @ values).reshape(-1, CUBIC + 1)[e]
        own = values[self.first[e] : self.first[e + 1]]
        x = np.linspace(-1.0, 1.0, _GRID)
        count = len(own) + 1
        inner = np.arange(1, count) / count
        powers = np.clip((0.5 * (x + 1.0)[:, None] - inner) / (1.0 - inner), 0.0, None) ** 3
        scale = self.curves[e].scale
        return np.asarray(scale * (legendre.legvander(x, CUBIC) @ cubic + powers @ own))


def _triangle(matrix: F64) -> F64:
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def _losses(whole: F64, kept: list[int]) -> F64:
    """By how much χ² rises without each of the columns that are kept; the last is what is left."""
    k = len(kept)
    r = _triangle(whole[:, [*kept, whole.shape[1] - 1]])
    inverse = np.linalg.pinv(r[:k, :k])
    values = inverse @ r[:k, k]
    return np.asarray(values**2 / np.maximum(np.einsum("ij,ij->i", inverse, inverse), 1e-300))


def _moved(term: Term, knots: tuple[float, ...], curve: _Curve) -> Term:
    """The effect with its knots; values that it had, as near as the new knots come."""
    effect = term.effect.model_copy(update={"positions": tuple(float(k) for k in knots)})
    if not term.values:
        return Term(effect)
    q = np.linspace(*curve.axis.travel, _GRID)
    old, new = _auto_shape(term.effect, curve.axis), _auto_shape(effect, curve.axis)
    values = old.basis(q, curve.axis) @ np.array([term.values[n].value for n in old.names])
    found = np.linalg.lstsq(new.basis(q, curve.axis), values, rcond=None)[0]
    return Term(effect, {n: Value(float(v)) for n, v in zip(new.names, found, strict=True)})


def _auto_shape(effect: Effect, axis: Axis) -> Shape:
    unit = np.pi / 180.0 if axis.rotary else 1.0
    return Shape.parse(AUTO, tuple(p * unit for p in getattr(effect, "positions", ())))


def widened(model: Model, wide: Model) -> Model:
    """A fitted model with the covariance of a wider one, whose knots were not picked by the data.

    The fewer knots, the surer they look; but they were picked because they fit. How uncertain a
    curve is says a fit with as many knots at equal distances as the richest of the curves needs.

    Parameters
    ----------
    model
        As fitted, with the knots that were chosen.
    wide
        The same model fitted with the others.
    """
    if model.covariance is None or wide.covariance is None:
        return model
    blocks, at = [], 0
    for term, other in zip(model.terms, wide.terms, strict=True):
        own = slice(at, at + len(other.values))
        at = own.stop
        if not finds_knots(term.effect):
            blocks.append(np.eye(len(term.values)))
            continue
        axis = model.machine.axis(str(getattr(term.effect, "axis", "")))
        q = np.linspace(*axis.travel, _GRID)
        few, many = (_auto_shape(e, axis).basis(q, axis) for e in (term.effect, other.effect))
        nearest = np.asarray(np.linalg.lstsq(few, many, rcond=None)[0])
        # fewer knots cannot show all of it: the curve's mean variance is kept
        wanted, shown = (
            float(np.einsum("gi,ij,gj->", b, wide.covariance[own, own], b))
            for b in (many, few @ nearest)
        )
        blocks.append(nearest * max(1.0, np.sqrt(wanted / shown)) if shown > 0.0 else nearest)
    rows = np.concatenate([[0], np.cumsum([len(b) for b in blocks])])
    columns = np.concatenate([[0], np.cumsum([b.shape[1] for b in blocks])])
    onto = np.zeros((int(rows[-1]), int(columns[-1])))
    for i, block in enumerate(blocks):
        onto[rows[i] : rows[i + 1], columns[i] : columns[i + 1]] = block
    covariance = onto @ wide.covariance @ onto.T
    covariance = 0.5 * (covariance + covariance.T)
    sd = iter(np.sqrt(np.diag(covariance)))
    values = [{n: Value(v.value, float(next(sd))) for n, v in t.values.items()}
              for t in model.terms]  # fmt: skip
    return replace(model.with_values(values), covariance=covariance)
