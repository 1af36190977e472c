"""What a test of rotary axes shows only together: which unknowns, and what would tell them apart.

A head's pivot, where its axis stands when it shows 0 and where its line lies can move the tool's
tip alike. Which do is found from the chain at the poses that were measured: the null space of the
equations. Whether another tool, or a sphere whose place is known, would tell them apart is found
likewise: by the same directions at the same poses with these.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.sentences import joined, said

F64 = NDArray[np.float64]

OTHER_TOOL = 100.0
"""mm by which a second tool is longer."""
_PART = 1e-6
"""Part of a combination's largest member from which on an unknown belongs to it."""
_FELT = 1e-4
"""mm by which the tool must miss for a believable amount of a combination to be told."""


@dataclass(frozen=True, slots=True)
class OnlyTogether:
    """A combination of unknowns of which a test shows only the sum.

    Attributes
    ----------
    names
        The unknowns, as they are reported (``E_B0B``), the one that is taken as 0 first.
    tool, placed
        Whether a tool that is `OTHER_TOOL` longer, or a sphere at a known place, tells them apart.
    """

    names: tuple[str, ...]
    tool: bool
    placed: bool

    def words(self) -> str:
        """One sentence: which, what is taken as 0, and what to measure."""
        if self.tool:
            then = said(
                "entered so the tool is right at this length only; what tells them apart: the same "
                "once more with a tool that is {size} mm longer",
                size=f"{OTHER_TOOL:g}",
            )
        elif self.placed:
            then = said("a sphere whose place is known (--placed) tells them apart")
        else:
            then = said("no pose tells them apart, and no part shows it")
        return said(
            "{names} show only together, {first} is taken as 0: {then}",
            names=joined(self.names, ", "), first=self.names[0], then=then,
        )  # fmt: skip

    @property
    def matters(self) -> bool:
        """Whether anything measured could show a difference."""
        return self.tool or self.placed


def only_together(result: FitResult, first: Sequence[Sequence[int]]) -> Iterator[OnlyTogether]:
    """The combinations of a fit's unknowns that its poses do not tell apart.

    Parameters
    ----------
    result
        The fit of lines and spindle.
    first
        Indices of unknowns that are taken as 0 where nothing tells, those first asked first.
    """
    problem = result.problem
    scale = problem.layout.scale
    null = np.hstack([result.null.convention, result.null.unknown]) * scale[:, None]
    null = null[: problem.layout.model_size]
    order = [i for rows in first for i in rows]
    order += [i for i in range(len(null)) if i not in order]
    longer, known = _with_longer_tool(problem.campaign, result), _placed(problem.campaign)
    names = [u.name for u in problem.layout.unknowns[: len(null)]]
    every = list(_by_pivots(null, scale[: len(null)], order))
    for number, direction in enumerate(every):
        size = np.abs(direction / scale[: len(null)])
        members = [i for i in order if size[i] > _PART * size.max()]
        if len(members) < 2:
            continue
        amount = direction / size.max()
        others = np.array(every[:number] + every[number + 1 :]).reshape(-1, len(null)).T
        yield OnlyTogether(
            tuple(names[i] for i in members),
            *(_told(result, campaign, amount, others) for campaign in (longer, known)),
        )


def _by_pivots(null: F64, scale: F64, order: Sequence[int]) -> Iterator[F64]:
    """The directions of a null space, each with an unknown of its own: the first by `order`."""
    left = (null / scale[:, None]).T.copy()
    done: list[int] = []
    for i in order:
        rows = [r for r in range(len(left)) if r not in done]
        if not rows:
            break
        best = max(rows, key=lambda r: abs(left[r, i]))
        if abs(left[best, i]) <= _PART * np.abs(left).max():
            continue
        left[best] /= left[best, i]
        for r in range(len(left)):
            if r != best:
                left[r] -= left[r, i] * left[best]
        done.append(best)
    yield from (left[r] * scale for r in done)


def _told(result: FitResult, campaign: Campaign, amount: F64, others: F64) -> bool:
    """Whether a campaign would show a combination, whatever the other combinations do."""
    problem = Problem(result.problem.model, campaign, sd=np.ones(campaign.n))
    theta = result.theta[: problem.layout.size]
    columns = problem.columns(theta)[:, : len(amount)]
    seen = problem.eliminator(theta).project(columns @ np.column_stack([amount, others]))
    left = seen[:, 0] - seen[:, 1:] @ np.linalg.lstsq(seen[:, 1:], seen[:, 0], rcond=_PART)[0]
    return bool(np.sqrt(np.mean(left**2)) > _FELT)


def _placed(campaign: Campaign) -> Campaign:
    setups = {n: replace(s, free=()) for n, s in campaign.setups.items()}
    return replace(campaign, setups=setups)


def _with_longer_tool(campaign: Campaign, result: FitResult) -> Campaign:
    """The same poses of the tip with a tool that is longer, or 100 mm long where there was none."""
    c = campaign.conditions
    chain = Chain(result.problem.model.machine, c)
    longer = c.tool - np.array([0.0, 0.0, OTHER_TOOL])
    beside = chain.to_machine_axes(chain.orientation @ np.array([0.0, 0.0, OTHER_TOOL]))
    back = {a: beside[:, k] for k, a in enumerate("XYZ") if a in c.positions}
    return replace(campaign, conditions=replace(c.moved(back), tool=longer))
