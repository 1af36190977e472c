"""Candidates: every effect that the catalogue proposes for a machine and a campaign."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.diagnosis.screening.evidence import RIGID_BODY, cost_of
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import FOLDS
from abbe.compcore.diagnosis.screening.several_waves import one_wave, waves_of
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.instruments.laser import PRESSURES, air_signals
from abbe.compcore.effects.registry import effect_kinds
from abbe.compcore.effects.signals import LAGGING, LaggedEffect
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.detail import finer, no_finer_than_seen
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import identity

RIGID = (
    "positioning",
    "straightness",
    "angular",
    "rotary_location",
    "spindle_location",
    "rotary_positioning",
    "rotary_radial",
    "rotary_axial",
    "rotary_tilt",
)
"""Error motions of a rigid axis, linear or rotary: any function of the axis's own position."""

PLAIN = ("scale", "squareness", "rotary_location", "spindle_location", "spindle_squareness")
"""The plain geometry that every machine has: constants of its axes."""

ALONG_AN_AXIS = ("cyclic", "local_defect", "joint")
"""Causes that are a function of one linear axis's position, as an error motion of any detail is."""

Cause = tuple[str, tuple[tuple[str, str], ...]]
"""Kind and place of an effect (`identity`)."""

OF_A_LASER = ("dead_path", "air_refraction", "cosine")
"""What only a light beam does to its readings."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect to be tried.

    Attributes
    ----------
    effect
        The effect.
    cost
        What makes it less likely before any data are seen (`evidence.cost_of`).
    choices
        Non-linear parameters to try, one mapping each; one empty mapping where there are none.
    everywhere
        Whether it is a cause of the instrument that acts on the whole campaign. Nothing was then
        measured without it, and what a machine's cause explains as well is the machine's.
    expected
        Whether every machine has it, and the model lacks it altogether: plain geometry, and error
        motions of its axes.
    through
        Where the model's unknowns would stand beside it, for one that acts through the model's
        effects (`acting_through`); None: where they were fitted without it.
    """

    effect: Effect
    cost: float
    choices: tuple[Mapping[str, float], ...] = field(default=({},))
    everywhere: bool = False
    expected: bool = False
    through: NDArray[np.float64] | None = field(default=None, repr=False)

    def at(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """The unknowns at which its columns are made, of a model fitted to θ."""
        return theta if self.through is None else self.through

    @cached_property
    def cause(self) -> Cause:
        """What makes it the same cause as another, whatever the detail (`identity`)."""
        return identity(self.effect)

    @property
    def nonlinear_count(self) -> int:
        """Number of non-linear parameters chosen from the data."""
        return len(self.choices[0])


def candidates(
    model: Model, campaign: Campaign, kinds: Collection[str] | None = None
) -> list[Candidate]:
    """All instances that the effects enumerate, less what the model has, plus more detail.

    Of some kinds only, and then no more detail of what the model has.
    """
    machine = model.machine
    coverage = campaign.coverage()
    present = {identity(effect) for effect in model.effects}
    found: list[Candidate] = []
    seen: set[str] = set()
    lasers = stated_laser(campaign, machine)
    one_place = all(n <= 1 for n in coverage.places.values())
    for cls in effect_kinds().values():
        if kinds is not None and cls.kind not in kinds:
            continue
        if cls.kind in OF_A_LASER and not lasers:
            continue
        for usual in _in_seen_detail(cls.candidates(machine, coverage), campaign, machine):
            effect = _not_yet(usual, present)
            if effect is None or (spec := effect.spec) in seen:
                continue
            if not coverage.duration and getattr(effect, "tau", None) is not None:
                continue  # no clock, no lag
            if one_place and _says_again(effect, model.effects):
                continue
            try:
                effect.check(machine)
            except InputError:
                continue
            seen.add(spec)
            cost = cost_of(effect, machine, len(campaign.setups))
            expected = effect.kind in RIGID or effect.kind in PLAIN
            cost += RIGID_BODY if expected else 0.0
            choices = tuple(_unlike(effect, model, tuple(_choices(effect, machine, coverage))))
            if not choices:
                continue
            everywhere = acts_everywhere(effect, coverage)
            found.append(Candidate(effect, cost, choices, everywhere, expected))
    if kinds is None:
        found += _refinements(model, campaign)
    return found


def _in_seen_detail(
    proposed: Iterable[Effect], campaign: Campaign, machine: Machine
) -> Iterator[Effect]:
    """Effects as they are proposed; curves over few targets smoother, and as tables (ISO 230-2)."""
    for usual in proposed:
        effect = no_finer_than_seen(usual, campaign.conditions, machine)
        yield effect
        if effect is not usual:
            for detail in finer(effect, campaign.conditions, machine):
                if detail.get("shape") == "table":
                    yield effect.model_copy(update=detail)


def _not_yet(effect: Effect, present: set[Cause]) -> Effect | None:
    """An effect, or the next of its kind, that a model does not have; None where it has it."""
    found: Effect | None = effect
    while found is not None and identity(found) in present:
        found = found.next_one()
    return found


def _says_again(effect: Effect, known: Sequence[Effect]) -> bool:
    """Whether a shift by a difference stands beside a shift by one of its two thermometers.

    Seen at one place, where a lean is a shift: the other thermometer alone says as much then, and
    the difference at once beside a body that follows late would be that body's derivative.
    """
    read = set(effect.signals_needed())
    if len(read) < 2 or effect.kind not in ("thermal_offset", "thermal_tilt"):
        return False
    beside = (e for e in known if e.kind == "thermal_offset" and len(e.signals_needed()) == 1)
    along = getattr(effect, "direction", None)
    return any(
        set(e.signals_needed()) <= read and along in (None, getattr(e, "direction", ""))
        for e in beside
    )


def acts_everywhere(effect: Effect, coverage: Coverage) -> bool:
    """Whether an effect is one of the instrument that no set-up of a campaign is without.

    A thermometer that reads wrong is the machine's own: it stays when the instrument is gone.
    """
    if effect.scope != "instrument" or effect.reads_model:
        return False
    setup, base = getattr(effect, "setup", None), getattr(effect, "base", None)
    if base is not None:
        return set(coverage.bases) <= {base}
    own = {setup} if setup is not None else set(getattr(effect, "setups", None) or ())
    return not own or set(coverage.setups) <= own


def stated_laser(campaign: Campaign, machine: Machine) -> bool:
    """Whether a campaign's head says that its instrument, or one of them, measures by laser.

    Of heads that name no instrument the air's pressure says it, recorded beside displacements: a
    beam's wavelength follows it, and nothing that machines are made of.
    """
    stated = " ".join(str(head.get("instrument", "")) for head in campaign.metadata).strip()
    if not stated:
        recorded = (s for s in machine.signals.values() if s.name in campaign.coverage().signals)
        return any(s.unit in PRESSURES for s in air_signals(recorded))
    return any(word in stated.lower() for word in ("laser", "interferom", "tracker", "etalon"))


def _refinements(model: Model, campaign: Campaign) -> Iterator[Candidate]:
    """Splines, polynomials and waves of the model with more coefficients.

    Twice as many, four times and so on: what is far finer than the shape that is there, as the
    waves that a rail's bolts make, is not seen by twice the detail. Tables beside splines only
    where few set-ups follow each axis closely: in many, they imitate what other axes do.
    """
    machine = model.machine
    few = len(campaign.setups) < FOLDS
    for effect in model.effects:
        if _follows_late(effect, campaign, machine):
            late = effect.model_copy(update={"tau": "fit"})
            choices = tuple(_choices(late, machine, campaign.coverage()))
            yield Candidate(late, cost_of(late, machine, 1), choices)
        axis = getattr(effect, "axis", None)
        if axis is None or axis not in campaign.conditions.positions:
            continue
        details = finer(effect, campaign.conditions, machine)
        for number, detail in enumerate(details):
            if number and detail.get("shape") == "table" and not few:
                continue
            refined = effect.model_copy(update=detail)
            yield Candidate(refined, cost_of(refined, machine, 1))


def _follows_late(effect: Effect, campaign: Campaign, machine: Machine) -> bool:
    """Whether a body that a model moves at once by a signal may follow it late.

    The signal is then not measured on that body itself.
    """
    names = effect.signals_needed()
    return (
        isinstance(effect, LaggedEffect)
        and effect.tau is None
        and bool(campaign.coverage().duration)
        and all(machine.signals[name].role in LAGGING for name in names)
        and set(names) <= set(campaign.coverage().signals)
    )


def _unlike(
    effect: Effect, model: Model, choices: Sequence[Mapping[str, float]]
) -> Iterator[Mapping[str, float]]:
    """Of the choices of one more wave of an axis those that are not a wave that it has."""
    known = waves_of(model, effect)
    for chosen in choices:
        if not known or all(not one_wave(effect, model, chosen["period"], k) for k in known):
            yield chosen


def _choices(effect: Effect, machine: Machine, coverage: Coverage) -> Iterator[Mapping[str, float]]:
    """Every combination of the values at which a search for non-linear parameters begins."""
    parameters = effect.search(machine, coverage)
    if not parameters:
        yield {}
        return
    for values in product(*(p.starts for p in parameters)):
        yield dict(zip((p.name for p in parameters), map(float, values), strict=True))
