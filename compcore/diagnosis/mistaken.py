"""Mistakes of a campaign, tried like causes: exchanged columns, late clocks, turned signs, inches.

A mistake has no parameter of its own. So where the same model, fitted to the campaign as it would
be without it, leaves less than half of what is more than noise, nothing that has to be fitted says
it as plainly. What judges is the model with all error motions of its linear axes, its scales'
expansions and the places of its rotary axes: beside a bare machine neither way would agree with
anything.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.steady_thermometers import steadied
from abbe.compcore.campaign.thinning import thinned
from abbe.compcore.campaign.units_of_set_ups import other_units, perhaps_other_units
from abbe.compcore.diagnosis.late_logger import HOURS, read_later, shown_later
from abbe.compcore.diagnosis.screening.body_motions import with_all_motions
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.fitting.gauss_newton import gauss_newton
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import Sentence, joined, said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_FALLS = 0.5
"""Part of χ² beyond noise that may be left without a mistake; of all χ² where noise is unknown."""
_WORTH = 50.0
"""Least fall of χ²: of as many parameters, this is beyond chance also where few rows are free."""
_ENOUGH = 20
"""Degrees of freedom from which on χ² is judged."""
_SURE = 10.0
"""Standard uncertainties by which a set-up's factor has to differ from 1."""
_CLOSE = 0.1
"""Part by which it may be off the factor that it is taken for."""
_WORST = 3
"""Set-ups of which most is left, whose positions are tried in another unit where none look so."""
_MOST = 8
"""Thermometers beyond which the likeliest exchanges are no longer asked one by one."""


@dataclass(frozen=True)
class Without:
    """The campaign without a mistake: what is left beyond noise, and whether that is beyond chance.

    `left` and `sure` of the same model; `before` and `after`, χ² per degree of freedom.
    """

    left: float
    sure: bool
    before: float
    after: float

    @classmethod
    def of(cls, as_it_is: FitResult, chi2: float) -> Without:
        """By χ² of the campaign as it is, and without the mistake."""
        noise = 0.0 if as_it_is.uncertainty.open else float(as_it_is.dof)
        # less than noise leaves is no better than noise
        left = max(chi2 - noise, 0.0) / (as_it_is.chi2 - noise)
        fall = as_it_is.chi2 - chi2
        dof = as_it_is.dof
        return cls(left, left < _FALLS and fall > _WORTH, as_it_is.chi2_per_dof, chi2 / dof)

    def words(self) -> Sentence:
        """How much better the campaign then agrees."""
        return said(
            "χ² per degree of freedom is then {after} instead of {before}, with no parameter more",
            after=in_digits(self.after), before=in_digits(self.before),
        )  # fmt: skip


@dataclass(frozen=True)
class Mistake:
    """What somebody mistook, and by what part of χ² the campaign speaks for it.

    Attributes
    ----------
    text
        What it is, by what it is seen, what to do.
    without
        How much better the campaign agrees without it.
    """

    text: Sentence
    without: Without

    @property
    def words(self) -> Sentence:
        """All of it."""
        return joined([self.text, self.without.words()])


def mistakes(model: Model, campaign: Campaign) -> tuple[Mistake, ...]:
    """What a campaign's writer seems to have mistaken, the surest first; of one kind only.

    Parameters
    ----------
    model
        The model as it is; it may have no effects.
    campaign
        The measurements.
    """
    campaign = steadied(campaign, model.machine)
    rows = thinned(campaign)
    if rows is not None:
        campaign = campaign.rows(rows)
    judge = with_all_motions(model, campaign)
    as_it_is = _fitted(judge, campaign)
    if as_it_is is None or as_it_is.dof < _ENOUGH:
        return ()
    if not (as_it_is.uncertainty.open or as_it_is.chi2 - as_it_is.dof > _WORTH):
        return ()
    for kind in (_units, _exchanged, _late, _factors):
        if found := sorted(kind(as_it_is, campaign), key=lambda m: m.without.left):
            return tuple(found)
    return ()


def _fitted(model: Model, campaign: Campaign) -> FitResult | None:
    try:
        return fit(model, campaign, near=True)
    except FitError:
        return None


def _without(as_it_is: FitResult, campaign: Campaign) -> Without:
    """The same model, with the same uncertainties, fitted to a campaign without a mistake."""
    problem = Problem(as_it_is.model, campaign, sd=as_it_is.problem.sd)
    return Without.of(as_it_is, _left(problem, as_it_is.theta))


def _left(problem: Problem, theta: F64) -> float:
    """χ² that is left of a problem, fitted from these unknowns on."""
    with threads_for(problem.n * problem.layout.size):
        theta, _ = gauss_newton(problem, theta)
        left = problem.eliminator(theta).project(problem.residual(theta))
    return float(left @ left)


def _may_fall(as_it_is: FitResult, part: Campaign, kept: NDArray[np.bool_]) -> bool:
    """Whether a part of the rows, read otherwise, leaves less than it does in the fit of all.

    True also where unknowns of the fit of all are in no row of the part (a set-up's, a base
    point's): only a fit of the part can say then.
    """
    problem = Problem(as_it_is.model, part, sd=as_it_is.problem.sd[kept])
    if problem.layout.size != as_it_is.theta.size:
        return True
    before = float(np.sum(as_it_is.weighted[kept] ** 2))
    return before - _left(problem, as_it_is.theta) > _WORTH


def _units(as_it_is: FitResult, campaign: Campaign) -> Iterator[Mistake]:
    """Positions of one set-up in another unit or sense, where the values agree that they are."""
    machine, conditions = as_it_is.model.machine, campaign.conditions
    setup = conditions.setup
    if setup is None:
        return
    left = {n: float(np.mean(as_it_is.weighted[setup == n] ** 2)) for n in campaign.setups}
    worst = sorted(left, key=lambda n: -left[n])[:_WORST]
    seen = list(other_units(campaign, machine))
    tried = [seen] if seen else [[o] for o in perhaps_other_units(campaign, machine, worst)]
    for others in tried:
        positions = dict(conditions.positions)
        for other in others:
            scaled = positions[other.axis] * other.factor
            positions[other.axis] = np.where(setup == other.setup, scaled, positions[other.axis])
        moved = replace(conditions, positions=positions)
        without = _without(as_it_is, replace(campaign, conditions=moved))
        if without.sure:
            yield from (Mistake(other.words(campaign, machine), without) for other in others)


def _exchanged(as_it_is: FitResult, campaign: Campaign) -> Iterator[Mistake]:
    """Two thermometers of which each seems to stand in the other's column.

    That one effect follows another thermometer than its own is a cause, and is named as such; here
    both have to fit the other's place, and neither alone may say as much.
    """
    signals = campaign.conditions.signals
    machine = as_it_is.model.machine
    used = {s for e in as_it_is.model.effects for s in e.signals_needed()}
    names = sorted(n for n in used if n in signals and machine.signals[n].temperature)
    if len(names) > _MOST:
        return
    for one, other in combinations(names, 2):
        both = {one: signals[other], other: signals[one]}
        exchanged = _without(as_it_is, _reading(campaign, both))
        if not exchanged.sure:
            continue
        alone = min(
            _without(as_it_is, _reading(campaign, {name: values})).left
            for name, values in both.items()
        )
        if exchanged.left < _FALLS * alone:
            apart = float(np.sqrt(np.nanmean((signals[one] - signals[other]) ** 2)))
            yield Mistake(
                said(
                    "{one} and {other} look exchanged (they read {apart} K apart, rms). Look which "
                    "cable is on which channel; exchange the two columns of the file, or their "
                    "names in the model",
                    one=one, other=other, apart=in_digits(apart, 2),
                ),
                exchanged,
            )  # fmt: skip


def _late(as_it_is: FitResult, campaign: Campaign) -> Iterator[Mistake]:
    """All thermometers whole hours late, as by a logger's clock that knows no summer time.

    By half as much they must agree much worse: else they are late in their housings.
    """
    machine = as_it_is.model.machine
    for hours in HOURS:
        seconds = 3600.0 * hours
        kept = shown_later(campaign, seconds)
        if kept is None or not read_later(campaign, machine, seconds):
            return
        shown = _reading(campaign, read_later(campaign, machine, seconds)).rows(kept)
        # what these rows' own fit leaves is no more than what the fit of all rows leaves of them
        if not _may_fall(as_it_is, shown, kept):
            continue
        beside = _fitted(as_it_is.model, campaign.rows(kept))
        if beside is None or beside.dof < _ENOUGH or beside.chi2 - beside.dof < _WORTH:
            continue
        late = _without(beside, shown)
        if not late.sure:
            continue
        by_half = _reading(campaign, read_later(campaign, machine, 0.5 * seconds)).rows(kept)
        if late.left < _FALLS * _without(beside, by_half).left:
            yield Mistake(
                said(
                    "the thermometers look {hours} h late: the machine is at each moment as warm "
                    "as they read {hours} h after it (summer time, or the clock of another zone?). "
                    "Put their columns in the time of the readings",
                    hours=in_digits(hours),
                ),
                late,
            )


def _factors(as_it_is: FitResult, campaign: Campaign) -> Iterator[Mistake]:
    """Set-ups whose values agree with all others only times −1, or in another unit."""
    problem, setup = as_it_is.problem, campaign.conditions.setup
    if setup is None or len(campaign.setups) < 2:
        return
    small = campaign.kind < Kind.DISTANCE
    values = np.where(small, campaign.value * problem.weight, 0.0)
    names = [n for n in campaign.setups if (small & (setup == n)).any()]
    if not names:
        return
    columns = np.stack([np.where(setup == n, values, 0.0) for n in names], axis=1)
    left = as_it_is.residualise(columns)
    for k, name in enumerate(names):
        own = left[:, k]
        square = float(own @ own)
        if square <= 1e-9 * float(columns[:, k] @ columns[:, k]):
            continue
        by = float(own @ as_it_is.weighted) / square
        after = as_it_is.chi2 - by**2 * square
        sd = float(np.sqrt(max(after, 0.0) / max(1, as_it_is.dof - 1) / square))
        factor = 1.0 - by
        for times, words in _MISTAKEN.items():
            taken = (1.0 - times) * (2.0 * by - (1.0 - times)) * square
            without = Without.of(as_it_is, as_it_is.chi2 - taken)
            # what agrees with nothing is best multiplied by nothing, which is near 1/25.4
            near = max(abs(factor - times), sd) < _CLOSE * abs(times)
            if near and abs(times - 1.0) > _SURE * sd and without.sure:
                yield Mistake(
                    said(
                        "the values of the set-up {name} {words}: the others ask for them times "
                        "{factor} ± {sd}. Multiply its column value by {times}",
                        name=name, words=words, times=_signed(f"{times:.4g}"),
                        factor=_signed(f"{factor:.3g}"), sd=f"{sd:.1g}",
                    ),
                    without,
                )  # fmt: skip


_MISTAKEN: Mapping[float, Sentence] = {
    -1.0: said(
        "have the other sign than those of all others (measured from the other end, nominal − "
        "actual?)"
    ),
    25.4: said("look like thousandths of an inch"),
    1.0 / 25.4: said("look as if they were multiplied by 25.4"),
    1e3: said("look like mm, not µm"),
    1e-3: said("look like nm, not µm"),
}


def _reading(campaign: Campaign, read: Mapping[str, F64]) -> Campaign:
    """The campaign with other readings of some thermometers."""
    c = campaign.conditions
    read_so = replace(c, signals={**c.signals, **read}, _lags={}, _known=None)
    return replace(campaign, conditions=read_so)


def _signed(number: str) -> str:
    return number.replace("-", "−")
