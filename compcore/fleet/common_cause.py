"""The same cause on several machines of a type, each of which shows it too weakly to be named."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect, Parameter
from abbe.compcore.errors import InputError
from abbe.compcore.fleet.mixture import Mixture, ToldOfCause, mixture
from abbe.compcore.fleet.told import CampaignTold, DiagnosedMachine
from abbe.compcore.units import in_digits, read_in

F64 = NDArray[np.float64]

LIKELY = 0.5
"""Chance above which a machine is said to have the cause."""
ENOUGH = 12.0
"""Evidence, after the price of all causes tried, from which on one is named: by the union bound
noise alone says as much in one fleet of four hundred at most (exp(−6))."""
_FEWEST = 2
_MOST = 8
"""Common causes that are looked for one after the other."""
ALIKE = 6.0
"""Evidence by which another cause may be weaker and still not be told from the best."""


@dataclass(frozen=True, eq=False)
class CommonCause:
    """A cause that machines of a type have in common.

    Attributes
    ----------
    effect
        It.
    evidence
        In 2·ln(likelihood), after the price of having looked for it among all others; `ENOUGH` is.
    machines
        Names of those that were asked: their models lack it, and their campaigns could show it.
    chances
        Of each that it has it.
    alone
        Of those, the ones whose own campaigns establish it.
    parameters
        Its linear parameters.
    mean, spread
        Of the parameters over the machines that have it, units inside the code.
    since
        After which campaigns show it, and none before; None: campaigns of all dates do.
    confusable
        Specs of causes that say nearly the same over these machines.
    """

    effect: Effect
    evidence: float
    machines: tuple[str, ...]
    chances: F64
    alone: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    mean: F64
    spread: F64
    since: datetime | None
    confusable: tuple[str, ...]

    @property
    def having(self) -> tuple[str, ...]:
        """Names of the machines that have it."""
        return tuple(
            n for n, chance in zip(self.machines, self.chances, strict=True) if chance > LIKELY
        )

    def words(self) -> Iterator[str]:
        """It, in a few lines."""
        since = "" if self.since is None else f" since {self.since:%Y-%m-%d}"
        count, of = len(self.having), len(self.machines)
        yield f"{self.effect.spec}: the same on {count} of {of} machines{since}"
        chances = dict(zip(self.machines, self.chances, strict=True))
        yield f"  on {', '.join(f'{n} ({100.0 * chances[n]:.0f} %)' for n in self.having)}"
        alone = [name for name in self.having if name in self.alone]
        if alone:
            yield f"  named alone already: {', '.join(alone)}"
        for p, mean, spread in zip(self.parameters, self.mean, self.spread, strict=True):
            shown, factor = read_in(p)
            scatter = f"machines scatter by {in_digits(spread * factor, 2)}"
            yield f"  {p.name} = {in_digits(mean * factor)} {shown}, {scatter}"
        yield f"  evidence {self.evidence:.0f} ({ENOUGH:g} is enough)"
        if self.confusable:
            yield f"  could also be: {'; '.join(self.confusable)}"


def common_causes(
    machines: Sequence[DiagnosedMachine], since: datetime | None = None
) -> list[CommonCause]:
    """Causes that machines have in common, the strongest first.

    Parameters
    ----------
    machines
        Diagnosed campaigns: several of one machine have the same name.
    since
        When something may have happened to all of them; default: every date between two campaigns
        is tried, and paid for.

    Raises
    ------
    InputError
        For fewer than two machines, and campaigns without dates where `since` is given.
    """
    if len({m.name for m in machines}) < _FEWEST:
        raise InputError(
            "a common cause is one of several machines",
            found=len({m.name for m in machines}),
            expected="two or more",
        )
    if since is not None and any(m.at is None for m in machines):
        unknown = next(m.name for m in machines if m.at is None)
        raise InputError(
            "a campaign's date is not known", field="--since", found=unknown, expected="a date"
        )
    present = list(machines)
    found: list[CommonCause] = []
    while len(found) < _MOST:
        ranked = ranked_causes(present, since)
        best = ranked[0] if ranked else None
        if best is None or best.evidence <= ENOUGH:
            break
        joined = [best.effect.spec]
        having = set(best.having)
        after = [m.beside([*_common(found, m.name), *joined]) if m.name in having else m
                 for m in present]  # fmt: skip
        rivals = [w for w in ranked[1:] if w.evidence > best.evidence - ALIKE]
        left = {w.effect.spec: w.evidence for w in _weighed(after, since)}
        said = tuple(w.effect.spec for w in rivals if left.get(w.effect.spec, -math.inf) <= ENOUGH)
        found.append(_with(best, said))
        present = after
    return found


def ranked_causes(
    machines: Sequence[CampaignTold], since: datetime | None = None
) -> list[CommonCause]:
    """Every cause that could be common to machines, the strongest evidence first.

    Parameters
    ----------
    machines, since
        As `common_causes` has them.
    """
    return sorted(_weighed(machines, since), key=lambda w: -w.evidence)


def _common(found: Sequence[CommonCause], name: str) -> list[str]:
    return [c.effect.spec for c in found if name in c.having]


def _with(cause: CommonCause, confusable: tuple[str, ...]) -> CommonCause:
    return replace(cause, confusable=confusable)


def _weighed(machines: Sequence[CampaignTold], since: datetime | None) -> Iterator[CommonCause]:
    """Every cause that at least two machines were asked about and could be common."""
    specs = dict.fromkeys(spec for m in machines for spec in m.told)
    for spec in specs:
        asked = [m for m in machines if spec in m.told]
        names = list(dict.fromkeys(m.name for m in asked))
        if len(names) < _FEWEST:
            continue
        dates = [since] if since is not None else _boundaries(asked)
        cost = min(m.effects[spec].cost for m in asked)
        # what every machine is expected to have is no reason to have it alike
        price = 2.0 * math.log(len(specs)) + max(0.0, cost)
        tries: list[tuple[datetime | None, float]] = [(None, 0.0)]
        tries += [(d, 2.0 * math.log(1 + len(dates)) if since is None else 0.0) for d in dates]
        best: CommonCause | None = None
        for date, paid in tries:
            weighed = _one(spec, asked, names, date, price + paid)
            if weighed is not None and (best is None or weighed.evidence > best.evidence):
                best = weighed
        if best is not None:
            yield best


def _one(
    spec: str, asked: Sequence[CampaignTold], names: Sequence[str], since: datetime | None,
    price: float,
) -> CommonCause | None:  # fmt: skip
    told = _by_machine(spec, asked, since)
    kept = [name for name in names if name in told]
    if len(kept) < _FEWEST:
        return None
    k = len(told[kept[0]].weighted)
    paid = price + (2 * k + 1) * math.log(len(kept))
    # no mixture says more than all machines, each with its own values
    if sum(told[name].drop for name in kept) - paid <= ENOUGH:
        return None
    found = mixture([told[name] for name in kept])
    evidence = min(found.gain - paid, _without_strongest(found, paid))
    tried = asked[0].effects[spec]
    having = [n for n, chance in zip(kept, found.chances, strict=True) if chance > LIKELY]
    if len(having) < _FEWEST:
        return None
    return CommonCause(
        tried.effect, evidence, tuple(kept), found.chances,
        tuple(dict.fromkeys(m.name for m in asked if spec in m.named)),
        tried.parameters, found.mean, np.sqrt(found.variances), since, (),
    )  # fmt: skip


def _without_strongest(found: Mixture, paid: float) -> float:
    """The evidence that does not rest on one machine: what the others say, as much again."""
    return 2.0 * (found.gain - float(found.gains.max())) - paid


def _by_machine(
    spec: str, asked: Sequence[CampaignTold], since: datetime | None
) -> Mapping[str, ToldOfCause]:
    """What each machine's campaigns say together; those before `since` are known to be without."""
    found: dict[str, ToldOfCause] = {}
    for m in asked:
        if since is not None and (m.at is None or m.at < since):
            continue
        one = m.told[spec]
        before = found.get(m.name)
        found[m.name] = (
            one
            if before is None
            else ToldOfCause(
                before.information + one.information,
                before.weighted + one.weighted,
                before.price + one.price,
            )
        )
    return found


def _boundaries(asked: Sequence[CampaignTold]) -> list[datetime]:
    """Dates that part the campaigns: one between every two that follow each other."""
    dates = sorted({m.at for m in asked if m.at is not None})
    several = len({m.name for m in asked}) < len(asked)
    if not several or any(m.at is None for m in asked):
        return []
    return [b for a, b in pairwise(dates) if (b - a).total_seconds() > 3600.0]
