"""The unknowns of a fit in one vector: parameters, and what belongs to placings and runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import NonlinearParameter, Parameter
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.design.run_starts import (
    Bodies,
    RunStart,
    beginning,
    likely_span,
    runs_with_a_clock,
)
from abbe.compcore.machine.typical import typical
from abbe.compcore.model.model import Model, Value

F64 = NDArray[np.float64]

BASE_SCALE = 1.0
"""How far from its stated place a base point or a tool may well lie, mm."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """One unknown of a fit: a parameter, or what a placing of instrument, tool or run leaves open.

    Attributes
    ----------
    owner
        Index of the model's term; -1 for a base point, a tool, or how warm a body began.
    name, unit
        Parameter name (``c3``, ``tau``, ``base B1 x``) and unit inside the code.
    scale
        A large but believable value, in `unit`: half the plausible range. Ranks and minimum norms
        are taken in units of it, so that mm and rad can be compared.
    nonlinear
        Whether the columns themselves depend on it.
    extent
        Whether it is a place, a period or a path, which people read in mm.
    """

    owner: int
    name: str
    unit: str
    scale: float
    nonlinear: bool = False
    extent: bool = False


def plausible_scale(parameter: Parameter | NonlinearParameter) -> float:
    """Half the width of a parameter's plausible range, in its own unit."""
    low, high = parameter.plausible
    return 0.5 * (high - low)


@dataclass(frozen=True)
class UnknownLayout:
    """The layout of θ, the vector of unknowns: effects' parameters, then what belongs to a placing.

    Term by term (linear parameters, then non-linear ones), then base points (x, y, z each), then
    the free components of tools, then where lagged bodies began in each run.

    Attributes
    ----------
    unknowns
        All of them, in order.
    terms, linear_counts
        For each of the model's terms its slice of θ, and how many of it are linear parameters.
    searched
        Index in θ → the non-linear parameter there, bounds and starts narrowed to what the campaign
        can show.
    bases, tools
        Name → slice of θ; the axes (0, 1, 2) that are free for tools.
    starts
        The beginnings of lagged bodies, run by run.
    """

    unknowns: tuple[Unknown, ...]
    terms: tuple[slice, ...]
    linear_counts: tuple[int, ...]
    searched: Mapping[int, NonlinearParameter] = field(default_factory=dict)
    bases: Mapping[str, slice] = field(default_factory=dict)
    tools: Mapping[str, tuple[slice, tuple[int, ...]]] = field(default_factory=dict)
    starts: tuple[RunStart, ...] = ()

    @classmethod
    def of(cls, model: Model, campaign: Campaign, bodies: Bodies = "asked") -> UnknownLayout:
        """The layout for a model and a campaign; base points that no row uses are left out.

        `bodies`: whose beginnings are free.
        """
        unknowns: list[Unknown] = []
        terms, counts = [], []
        searched: dict[int, NonlinearParameter] = {}
        coverage: Coverage | None = None
        for i, effect in enumerate(model.effects):
            linear = effect.linear(model.machine)
            start = len(unknowns)
            unknowns += [
                Unknown(i, p.name, p.unit, plausible_scale(p), extent=p.extent) for p in linear
            ]
            if nonlinear := effect.nonlinear(model.machine):
                coverage = campaign.coverage() if coverage is None else coverage
                # nothing is searched where its axis stands; the model has its value all the same
                for p in effect.search(model.machine, coverage) or nonlinear:
                    searched[len(unknowns)] = p
                    scale = plausible_scale(p)
                    unknowns.append(Unknown(i, p.name, p.unit, scale, True, p.extent))
            terms.append(slice(start, len(unknowns)))
            counts.append(len(linear))
        bases: dict[str, slice] = {}
        for name in _bases_used(campaign):
            bases[name] = slice(len(unknowns), len(unknowns) + 3)
            unknowns += [
                Unknown(-1, f"base {name} {k}", "mm", BASE_SCALE, extent=True) for k in "xyz"
            ]
        tools: dict[str, tuple[slice, tuple[int, ...]]] = {}
        for tool in campaign.tools.values():
            free = tuple("xyz".index(k) for k in tool.free)
            if free and bool((campaign.tool_name == tool.name).any()):
                tools[tool.name] = (slice(len(unknowns), len(unknowns) + len(free)), free)
                unknowns += [
                    Unknown(-1, f"tool {tool.name} {'xyz'[k]}", "mm", BASE_SCALE, extent=True)
                    for k in free
                ]
        starts = _starts(model, campaign, bodies, unknowns)
        return cls(tuple(unknowns), tuple(terms), tuple(counts), searched, bases, tools, starts)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.unknowns)

    @property
    def model_size(self) -> int:
        """Number of the effects' parameters, which stand first."""
        return self.terms[-1].stop if self.terms else 0

    @property
    def scale(self) -> F64:
        """The unknowns' scales, shape (size,)."""
        return np.array([u.scale for u in self.unknowns])

    def starts_of(self, term: int) -> list[RunStart]:
        """Where a term's bodies began, run by run."""
        return [start for start in self.starts if start.term == term]

    def linear_of(self, term: int) -> slice:
        """The place of a term's linear parameters in θ."""
        start = self.terms[term].start
        return slice(start, start + self.linear_counts[term])

    def nonlinear_of(self, term: int) -> range:
        """The places of a term's non-linear parameters in θ."""
        return range(self.linear_of(term).stop, self.terms[term].stop)

    def nonlinear_values(self, term: int, theta: F64) -> dict[str, float]:
        """A term's non-linear parameters by name, from θ."""
        return {self.unknowns[i].name: float(theta[i]) for i in self.nonlinear_of(term)}

    def within(self, theta: F64) -> F64:
        """θ with its non-linear parameters held within their bounds."""
        if not self.searched:
            return theta
        held = theta.copy()
        for i, parameter in self.searched.items():
            held[i] = min(max(held[i], parameter.bounds[0]), parameter.bounds[1])
        return held

    def start(self, campaign: Campaign) -> F64:
        """Start values of θ: no error, first starts, base points and tools as stated."""
        theta = np.zeros(self.size)
        for i, parameter in self.searched.items():
            theta[i] = parameter.starts[0]
        for name, where in self.bases.items():
            theta[where] = campaign.bases[name]
        for name, (where, free) in self.tools.items():
            theta[where] = np.asarray(campaign.tools[name].offset)[list(free)]
        return theta

    def of_model(self, model: Model, campaign: Campaign) -> F64:
        """θ with the model's own values; effects that are not fitted contribute nothing."""
        theta = self.start(campaign)
        for i, term in enumerate(model.terms):
            if term.fitted:
                names = [u.name for u in self.unknowns[self.terms[i]]]
                theta[self.terms[i]] = [term.values[name].value for name in names]
        return theta

    def values(
        self, theta: F64, sd: F64, shown: NDArray[np.bool_] | None = None
    ) -> list[dict[str, Value]]:
        """θ and its standard deviations as one mapping a term, for `Model.with_values`.

        `shown`, (size,): which of the unknowns the campaign shows; default all.
        """
        seen = np.ones(self.size, dtype=np.bool_) if shown is None else shown
        return [
            {
                u.name: Value(float(theta[j]), float(sd[j]), bool(seen[j]))
                for j, u in zip(range(where.start, where.stop), self.unknowns[where], strict=True)
            }
            for where in self.terms
        ]


def _starts(
    model: Model, campaign: Campaign, bodies: Bodies, unknowns: list[Unknown]
) -> tuple[RunStart, ...]:
    """Beginnings of the model's lagged bodies in a campaign's runs; joins their unknowns."""
    found: list[RunStart] = []
    conditions, machine = campaign.conditions, model.machine
    for i, effect in enumerate(model.effects):
        free = beginning(effect, machine, bodies)
        if not free:
            continue
        signal = machine.signals[effect.signals_needed()[0]]
        common = 0.5 * typical(signal).change
        for run, rows in runs_with_a_clock(conditions):
            first = len(unknowns)
            for p in free:
                name = f"{p.name} at first, run {run + 1}"
                unknowns.append(Unknown(-1, name, p.unit, plausible_scale(p) * common))
            found.append(
                RunStart(
                    i,
                    run,
                    float(conditions.time[rows].min()),
                    slice(first, len(unknowns)),
                    likely_span(machine, effect, conditions, rows),
                )
            )
    return tuple(found)


def _bases_used(campaign: Campaign) -> list[str]:
    if campaign.conditions.base is None:
        return []
    used = campaign.kind >= Kind.DISTANCE
    names = dict.fromkeys(map(str, np.unique(campaign.conditions.base[used])))
    names.update(dict.fromkeys(map(str, np.unique(campaign.base2[used]))))
    names.pop("", None)
    for name in names:
        if name not in campaign.bases:
            raise InputError(
                "a base point without approximate coordinates",
                field=f"bases.{name}",
                expected=f"[bases.{name}] position = [x, y, z] at the top of the campaign",
            )
    return list(names)
