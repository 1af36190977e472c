"""What a campaign recorded, as learners without a catalogue take it, and what they give back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import compare
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]

ORDER = 3
"""Most recorded quantities in a product of the library."""


@dataclass(frozen=True, eq=False)
class Term:
    """A column of the library: recorded quantities, and the component that they move."""

    quantities: tuple[str, ...]
    component: str

    def __str__(self) -> str:
        return "·".join([*self.quantities, *([f"u_{self.component}"] if self.component else [])])


@dataclass(frozen=True, eq=False)
class Inputs:
    """What a campaign recorded, scaled as the campaign that is learnt from.

    Attributes
    ----------
    names, columns
        Positions (of rotary axes sine and cosine), directions of approach, signals, time; (n, k).
    others
        Tool offset and, for distances, the base point: seen by the black boxes only, (n, m).
    toward
        The measured direction, (n, 3): of a distance the one from its base point; 0 for angles.
    marks
        Of distances: that it is one, its length, its base point; by name, each (n,).
    rows
        Displacements and distances, (n,).
    """

    names: tuple[str, ...]
    columns: F64
    others: F64
    toward: F64
    marks: dict[str, F64]
    rows: NDArray[np.bool_]

    @classmethod
    def of(cls, campaign: Campaign, like: Campaign, toward: F64) -> Inputs:
        """The inputs of a campaign; `toward` from its measurement equations."""
        own, other = _recorded(campaign), _recorded(like)
        extra, other_extra = _others(campaign, like), _others(like, like)
        far = campaign.kind == Kind.DISTANCE
        marks: dict[str, F64] = {}
        if like.bases:
            marks = {"distance": far * 1.0, "length": np.where(far, campaign.value, 0.0) / 1e3}
            marks |= {f"from {b}": far * np.equal(_bases(campaign), b) for b in like.bases}
        return cls(
            tuple(own),
            np.stack([_scaled(own[k], other[k], k) for k in own], axis=1),
            np.stack([_scaled(*v, "") for v in zip(extra.T, other_extra.T, strict=True)], axis=1),
            toward,
            marks,
            far | (campaign.kind == Kind.DISPLACEMENT),
        )

    @cached_property
    def features(self) -> F64:
        """For a black box: everything beside each other."""
        return np.hstack([self.columns, self.others, self.toward])

    @cached_property
    def library(self) -> tuple[list[Term], F64]:
        """Products of recorded quantities times each component of the direction; marks."""
        terms: list[Term] = []
        columns = []
        directions = {i for i, name in enumerate(self.names) if name.endswith("_dir")}
        for order in range(ORDER + 1):
            for which in combinations_with_replacement(range(len(self.names)), order):
                if len(set(which) & directions) < sum(i in directions for i in which):
                    continue  # the square of a direction says nothing
                product = np.prod(self.columns[:, list(which)], axis=1)
                for k, axis in enumerate("XYZ"):
                    terms.append(Term(tuple(self.names[i] for i in which), axis))
                    columns.append(product * self.toward[:, k])
        for name, mark in self.marks.items():
            terms.append(Term((name,), ""))
            columns.append(mark)
        return terms, np.stack(columns, axis=1)


def _recorded(campaign: Campaign) -> dict[str, F64]:
    c = campaign.conditions
    found: dict[str, F64] = {}
    for axis, position in c.positions.items():
        if is_rotary(axis):
            found |= {f"sin {axis}": np.sin(position), f"cos {axis}": np.cos(position)}
        else:
            found[axis] = position
    found |= {f"{a}_dir": s for a, s in c.directions.items()}
    return found | dict(c.signals) | {"t": c.time}


def _others(campaign: Campaign, like: Campaign) -> F64:
    """Tool offset and, where `like` has base points, the row's own, (n, m), mm.

    A row without one counts as if it had the middle of all.
    """
    if not like.bases:
        return campaign.conditions.tool
    middle = np.mean(list(like.bases.values()), axis=0)
    ends = [like.bases.get(str(name), middle) for name in _bases(campaign)]
    return np.hstack([campaign.conditions.tool, np.array(ends)])


def _bases(campaign: Campaign) -> NDArray[np.str_]:
    """Each row's base point by name; empty where there is none."""
    base = campaign.conditions.base
    return np.full(campaign.n, "") if base is None else base


def _scaled(values: F64, like: F64, name: str) -> F64:
    middle = 0.0 if name.endswith("_dir") else float(like.mean())
    return np.asarray((values - middle) / (float(like.std()) or 1.0))


@dataclass(frozen=True, eq=False)
class Learnt:
    """What a learner would correct, mm: at the rows it learnt from, and at unseen ones.

    `terms`: those that a sparse regression keeps, what they add to the campaign largest first.
    """

    seen: F64
    unseen: F64
    terms: tuple[Term, ...] = ()


def inputs(result: FitResult, unseen: Campaign) -> tuple[Inputs, Inputs]:
    """Of the campaign that a model was fitted to, and of an unseen one."""
    campaign = result.problem.campaign
    beside = compare(result.model, unseen)
    toward = result.problem.observation(result.theta).toward
    there = beside.problem.observation(beside.theta).toward
    return Inputs.of(campaign, campaign, toward), Inputs.of(unseen, campaign, there)
