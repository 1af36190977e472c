"""The noise floor: what repeated measurements say no model can beat.

Repeats spread over a day hold the machine's drift besides the noise: their plain standard deviation
is several times too large. So every repeat is compared with the line through its neighbours in
time (pseudo-residuals; Gasser, Sroka, Jennen-Steinmetz, Biometrika 73, 1986, 625): whatever drifts
evenly between three repeats drops out, at any spacing. Repeats that are too far apart in time do
not count; whether drift is left all the same is tested with every second repeat, for which it would
be larger. A few gross errors (a bumped mirror) are set aside and named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.pseudo_residuals import Differences, in_time, pairs, triples
from abbe.compcore.campaign.repeats import repeat_groups
from abbe.compcore.distributions import chi2_limit, f_limit
from abbe.compcore.errors import require_type
from abbe.compcore.machine.machine import Machine, OfMachine, machine_of
from abbe.compcore.sentences import joined, said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

GROSS = 5.0
"""A pseudo-residual beyond this many robust standard deviations is set aside."""
FEWEST_FOR_GROSS = 10
"""With fewer pseudo-residuals no gross error can be recognised."""
GREATEST_SHARE = 0.3
"""More uneven drift than this share of the variance cannot be taken off with confidence."""
FEWEST_PAIRS = 5
"""A set-up measured both ways counts towards the upper bound from so many positions on."""
CONFIDENCE = 0.95

KINDS: Mapping[str, tuple[Kind, ...]] = {
    "displacement": (Kind.DISPLACEMENT,),
    "rotation": (Kind.ROTATION,),
    "distance": (Kind.DISTANCE, Kind.BASE_DISTANCE),
}
_NAMES = {
    "displacement": said("displacement"),
    "rotation": said("rotation"),
    "distance": said("distance"),
}
_DISPLAY = {"displacement": ("µm", 1e3), "rotation": ("µrad", 1e6), "distance": ("µm", 1e3)}


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of one kind of measurement.

    Attributes
    ----------
    kind
        ``displacement``, ``rotation`` or ``distance``.
    value
        Standard deviation of one reading, mm or rad; None where it cannot be known. Where the
        campaign states uncertainties it is their root mean square times `ratio`.
    degrees_of_freedom
        Effective number, pooled over all groups (0 where unknown).
    interval
        95 % confidence interval of `value`, mm or rad.
    ratio
        Observed noise over stated uncertainty; None where none is stated.
    at_most
        An upper bound where `value` is None or doubtful, mm or rad; None where there is none.
    set_aside
        Line numbers of repeats left out as gross errors.
    setups
        Set-up → (standard deviation, mm or rad; degrees of freedom), where it has repeats.
    reason
        Why `value` is None, or what to mind; empty when all is well.
    """

    kind: str
    value: float | None = None
    degrees_of_freedom: float = 0.0
    interval: tuple[float, float] | None = None
    ratio: float | None = None
    at_most: float | None = None
    set_aside: tuple[int, ...] = ()
    setups: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    reason: str = ""

    def __str__(self) -> str:
        unit, scale = _DISPLAY[self.kind]
        kind, why = _NAMES[self.kind], self.reason
        if self.value is None or self.interval is None:
            if self.at_most is None:
                return said("{kind}: cannot be known: {reason}", kind=kind, reason=why)
            most = f"{in_digits(self.at_most * scale)} {unit}"
            return said(
                "{kind}: cannot be known: {reason}; at most {most}",
                kind=kind,
                reason=why,
                most=most,
            )
        low, high = (in_digits(limit * scale) for limit in self.interval)
        parts = [
            said(
                "{kind}: {value} (95 %: {low} to {high}; {n} degrees of freedom)",
                kind=kind,
                value=f"{in_digits(self.value * scale)} {unit}",
                low=low,
                high=high,
                n=f"{self.degrees_of_freedom:.0f}",
            )
        ]
        if self.ratio is not None:
            ratio = f"{self.ratio:.2f}"
            parts = [said("{noise}, {ratio} of what is stated", noise=parts[0], ratio=ratio)]
        return joined([*parts, why]) if why else parts[0]


@dataclass(frozen=True)
class NoiseFloor:
    """The noise of a campaign; `levels` by kind (``displacement``, …), only kinds that occur."""

    levels: Mapping[str, NoiseLevel]

    @property
    def lengths(self) -> NoiseLevel | None:
        """The noise of displacements, or of distances where there are none."""
        return self.levels.get("displacement") or self.levels.get("distance")

    def value(self, kind: str) -> float | None:
        """Standard deviation of one reading of a kind, mm or rad; None where not known."""
        level = self.levels.get(kind)
        return None if level is None else level.value

    def __str__(self) -> str:
        return "\n".join(self.words())

    def words(self) -> Iterator[str]:
        """One sentence for each kind."""
        for level in self.levels.values():
            yield said("noise floor, {level}", level=str(level))


def noise_floor(campaign: Campaign, machine: Machine | OfMachine | None = None) -> NoiseFloor:
    """Estimate the noise of each kind of measurement in a campaign from its repeats.

    With a machine, or a model of it, repeats under another load or speed do not count: see
    `repeat_groups`.
    """
    require_type(campaign, Campaign, "campaign")
    machine = None if machine is None else machine_of(machine)
    groups = repeat_groups(campaign, machine)
    back_and_forth = repeat_groups(campaign, machine, both_ways=True)
    levels = {}
    for name, kinds in KINDS.items():
        rows = np.isin(campaign.kind, kinds)
        if rows.any():
            bound = _both_ways(campaign, np.where(rows, back_and_forth, -1))
            levels[name] = _level(name, campaign, rows, np.where(rows, groups, -1), bound)
    return NoiseFloor(levels)


def _level(
    name: str, campaign: Campaign, rows: NDArray[np.bool_], groups: I64, bound: float | None
) -> NoiseLevel:
    if not (groups >= 0).any():
        never = said("nothing was measured twice in the same set-up, position and direction")
        return NoiseLevel(name, reason=never, at_most=bound)
    time = campaign.conditions.time
    near = triples(groups, time, 1)
    drift_free = near.count > 0
    if not drift_free:
        near = pairs(groups, time)
    if not near.count:
        late = said("the repeats lie too far apart in time: they hold drift besides the noise")
        return NoiseLevel(name, reason=late, at_most=bound)
    stated = bool(np.isfinite(campaign.sd[rows]).all())
    unit = campaign.sd if stated else np.ones(campaign.n)
    scaled = np.where(rows, _within_groups(campaign.value, groups) / np.where(rows, unit, 1.0), 0.0)
    residual = near.of(scaled)
    sound = _sound(residual)
    set_aside = tuple(sorted(set(campaign.line[near.middle[~sound]].tolist())))
    near, residual = near.keep(sound), residual[sound]
    freedom = near.degrees_of_freedom
    variance = float(np.mean(residual**2))
    typical = float(np.sqrt(np.mean(unit[rows] ** 2)))
    refused: str = ""
    paired = said("from pairs: what drifts between the two counts as noise")
    reason: str = "" if drift_free else paired
    if variance == 0.0:
        refused = said("the repeats agree exactly: the resolution hides the noise")
    elif not np.ptp(time[near.middle]) and near.count > 1:
        reason = said("the rows have no times: uneven drift counts as noise")
    elif drift_free:
        share = _drift_left(groups, time, scaled, variance, freedom)
        if share > GREATEST_SHARE:
            upper = float(np.sqrt(variance)) * typical
            bound = upper if bound is None else min(upper, bound)
            refused = said("the machine drifts too unevenly between the repeats")
        elif share > 0.0:
            variance *= 1.0 - share
            reason = said(
                "{share} of the variance was uneven drift and is taken off", share=f"{share:.0%}"
            )
    if refused:
        return NoiseLevel(name, at_most=bound, set_aside=set_aside, reason=refused)
    deviation = float(np.sqrt(variance)) * typical
    half = CONFIDENCE / 2
    low, high = (chi2_limit(p, freedom) for p in (0.5 - half, 0.5 + half))
    return NoiseLevel(
        name,
        value=deviation,
        degrees_of_freedom=freedom,
        interval=(
            deviation * math.sqrt(freedom / low),
            deviation * math.sqrt(freedom / high),
        ),
        ratio=float(np.sqrt(variance)) if stated else None,
        at_most=bound,
        set_aside=set_aside,
        setups=_by_setup(campaign, near, residual, unit),
        reason=reason,
    )


def _within_groups(value: F64, groups: I64) -> F64:
    """What each reading differs from the mean of its repeats by; of those without repeats 0.

    Their uncertainties are not the same to the last digit, and a distance of 800 mm over 0.69 µm is
    far from one over 0.71 µm: only what repeats differ by may be scaled.
    """
    own = groups >= 0
    if not own.any():
        return np.zeros_like(value)
    count = np.bincount(groups[own])
    mean = np.bincount(groups[own], value[own]) / np.maximum(count, 1)
    return np.where(own, value - mean[np.where(own, groups, 0)], 0.0)


def _sound(residual: F64) -> NDArray[np.bool_]:
    """Which residuals are no gross errors."""
    n = len(residual)
    spread = 1.4826 * float(np.median(np.abs(residual)))
    # readings of coarse resolution repeat exactly: then the spread says nothing
    if n < FEWEST_FOR_GROSS or spread == 0.0:
        return np.ones(n, dtype=np.bool_)
    # a spread estimated from few residuals may be much too small by chance
    return np.asarray(np.abs(residual) <= GROSS * (1.0 + FEWEST_FOR_GROSS / n) * spread)


def _drift_left(groups: I64, time: F64, value: F64, variance: float, freedom: float) -> float:
    """Share of the variance that is drift too uneven for a line; 0 where none is established.

    With every second repeat, drift as rough as a random walk would add twice as much, smooth drift
    16 times: the share follows from the growth, taken as fourfold.
    """
    wide = triples(groups, time, 2)
    if not wide.count:
        return 0.0
    residual = wide.of(value)
    wide = wide.keep(_sound(residual))
    growth = float(np.mean(wide.of(value) ** 2)) / variance if variance > 0.0 else 1.0
    if growth <= f_limit(0.001, wide.degrees_of_freedom, freedom):
        return 0.0
    return (growth - 1.0) / 3.0


def _by_setup(
    campaign: Campaign, differences: Differences, residual: F64, unit: F64
) -> dict[str, tuple[float, float]]:
    setup = campaign.conditions.setup
    if setup is None:
        return {}
    names, code = np.unique(setup[differences.middle], return_inverse=True)
    found = {}
    for i, name in enumerate(names.tolist()):
        mine = code.reshape(-1) == i
        part = differences.keep(mine)
        level = residual[mine] * unit[part.middle]
        found[name] = (float(np.sqrt(np.mean(level**2))), part.degrees_of_freedom)
    return found


def _both_ways(campaign: Campaign, groups: I64) -> float | None:
    """Standard deviation from going forth and back, mm or rad: an upper bound of the noise.

    Differences between the two directions, less their mean and what changes evenly with the time
    between them, set-up by set-up. Play that changes along the axis stays in: hence a bound.
    """
    setup, time = campaign.conditions.setup, campaign.conditions.time
    order = in_time(groups, time)
    if setup is None or len(order) < 2:
        return None
    a, b = order[:-1], order[1:]
    same = groups[a] == groups[b]
    a, b = a[same], b[same]
    difference = (campaign.value[b] - campaign.value[a]) * np.sqrt(0.5)
    between = time[b] - time[a]
    code = np.unique(setup[a], return_inverse=True)[1].reshape(-1)
    count = np.bincount(code)
    # a straight line of the difference over the time between, for all set-ups at once
    x = between - (np.bincount(code, between) / count)[code]
    y = difference - (np.bincount(code, difference) / count)[code]
    xx, xy, yy = (np.bincount(code, product) for product in (x * x, x * y, y * y))
    sloping = xx > 1e-12 * np.maximum(np.bincount(code, between**2), 1e-300)
    rest = yy - np.divide(xy**2, xx, out=np.zeros_like(xy), where=sloping)
    enough = count >= FEWEST_PAIRS
    freedom = int((count - 1 - sloping)[enough].sum())
    return float(np.sqrt(max(rest[enough].sum(), 0.0) / freedom)) if freedom else None
