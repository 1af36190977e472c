"""The verdict: complete, missing or unexplained; with everything that a report needs to say why.

At every step the catalogue's best candidate competes with the best description of the residuals'
structure (`patterns`). A cause from the catalogue is established only where nothing empirical says
clearly more: a wrong cause is worse than none. What the catalogue cannot explain is described.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.noise import NoiseFloor, noise_floor
from abbe.compcore.campaign.thinning import thinned
from abbe.compcore.diagnosis.advice import Advice, advise
from abbe.compcore.diagnosis.changed import Standing, standing
from abbe.compcore.diagnosis.explain import headline, parameter
from abbe.compcore.diagnosis.findings import Established, Findings, Verdict, measured_kinds
from abbe.compcore.diagnosis.judging.competition import (
    compete,
    reversals_described,
    rivals,
    standing_beside,
)
from abbe.compcore.diagnosis.judging.established import (
    established_cause,
    on_all_rows,
    standing_together,
)
from abbe.compcore.diagnosis.judging.foretelling import foretelling, predicting
from abbe.compcore.diagnosis.judging.known_before import beside_which_it_holds
from abbe.compcore.diagnosis.judging.second_order import Valued, beyond_first_order
from abbe.compcore.diagnosis.mistaken import mistakes
from abbe.compcore.diagnosis.pictures import diagnosis_figures
from abbe.compcore.diagnosis.screening.acting_through import acting_through
from abbe.compcore.diagnosis.screening.candidates import Candidate, candidates
from abbe.compcore.diagnosis.screening.frames import Frames
from abbe.compcore.diagnosis.screening.left_out.blocks import Blocks
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.strays import Stray, strays
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import Patterns, ResidualPattern
from abbe.compcore.diagnosis.words import diagnosis_words
from abbe.compcore.errors import FitError, require_type
from abbe.compcore.figures.figure import Figure
from abbe.compcore.figures.shown import Shown
from abbe.compcore.fitting.design.run_starts import Bodies
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.notebook import html_table
from abbe.compcore.sentences import counted, said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_ROUNDS = 5
"""How often readings that stand alone are looked for: a gross one hides others."""


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Findings, Shown):
    """What is missing in a model, by a campaign: `Findings`, in words, tables and pictures.

    `verdict` says whether something is missing, `established` what, the first to add first.
    """

    @cached_property
    def noise(self) -> NoiseFloor:
        """What repeated measurements of the campaign say that no model can beat."""
        problem = self.whole.problem
        return noise_floor(problem.campaign, problem.model.machine)

    @cached_property
    def advice(self) -> tuple[Advice, ...]:
        """What to measure next, the most useful first."""
        return tuple(advise(self))

    def words(self) -> Iterator[str]:
        """What ``abbe diagnose`` prints, with what to call instead of what to type.

        How wrong the model is, what is missing and why, what else it could be, what to do.
        """
        return diagnosis_words(self, self.noise, self.advice, _call)

    def summary(self) -> str:
        """The verdict, with the causes that are established."""
        unit, _, factor = self.unit
        names = "".join(f" {e.effect.spec}," for e in self.established)
        left = f"{in_digits(self.rms * factor)} {unit} rms"
        return f"{self.verdict}:{names} {left} left by the model as it is"

    def table(self) -> str:
        """The causes that are established, in HTML; without any the strongest candidates."""
        if self.established:
            rows = [
                [
                    e.effect.spec,
                    headline(e.effect),
                    ", ".join(parameter(v) for v in e.estimates[:3]),
                ]
                for e in self.established
            ]
            return html_table(["missing", "what it is", "fitted"], rows)
        strongest = [
            [f.candidate.effect.spec, headline(f.candidate.effect), float(f.evidence.value)]
            for f in self.ranked[:3]
            if np.isfinite(f.evidence.value)
        ]
        head = ["strongest of those tested", "what it is", "evidence (12 is convincing)"]
        return html_table(head, strongest)

    def figures(self) -> dict[str, Callable[[], Figure]]:
        """The pictures of ``abbe diagnose --report`` by name."""
        return diagnosis_figures(self)


def _call(spec: str) -> str:
    return f"abbe.add_effect(model, {spec!r})"


Progress = Callable[[str], None]


def diagnose(model: Model, campaign: Campaign, *, progress: Progress = lambda _: None) -> Diagnosis:
    """Find out what has changed, and which physical effect a model lacks, or that it lacks none.

    Parameters
    ----------
    model
        The model. As it was given it is laid beside the campaign first, where it has values with
        their covariance; then its effects are refitted.
    campaign
        The measurements.
    progress
        Called with a few words at the start of each stage.

    Raises
    ------
    FitError
        When the campaign has no rows, or no more than the model has unknowns.
    """
    require_type(model, Model, "model")
    require_type(campaign, Campaign, "campaign")
    progress("fitting the model as it is")
    known = bool(model.terms) and all(t.fitted for t in model.terms)
    # how warm bodies were when another run began the model does not say, and it is no change of it
    bodies: Bodies = "all" if known and not model.seen(campaign.files.values()) else "asked"
    found = _of_fit(fit(model, campaign, bodies=bodies), model, progress)
    progress("mistakes in the campaign")
    return replace(found, mistakes=mistakes(model, campaign))


def lacking(whole: FitResult, *, progress: Progress = lambda _: None) -> Diagnosis:
    """As `diagnose`, of a model that was just fitted to the campaign: only what it lacks.

    Nothing is fitted again, and nothing can have changed.
    """
    return _of_fit(whole, None, progress)


def _of_fit(whole: FitResult, given: Model | None, progress: Progress) -> Diagnosis:
    aside: list[Stray] = []
    for _ in range(_ROUNDS):
        found = _looked_at(whole, given, progress)
        alone = _stray(found)
        if not alone:
            break
        aside += alone.values()
        progress("without the readings that stand alone")
        whole = _without(whole, list(alone))
    return replace(found, strays=tuple(sorted(aside, key=lambda s: -s.size)))


def _stray(found: Diagnosis) -> dict[int, Stray]:
    """What stands alone beside the causes and beside the structure that is described."""
    beside = found.basis
    signatures = [e.signature for e in found.established]
    for structure in found.structure:
        columns = beside.project(structure.columns)
        coefficients = np.linalg.lstsq(columns, beside.residual, rcond=1e-10)[0]
        signatures.append(columns @ coefficients / found.result.problem.weight)
        beside = beside.extended(structure.columns)
    beside = found.pool.joined(beside, [e.found for e in found.established])
    return strays(found.result, found.basis, beside, signatures)


def _without(whole: FitResult, aside: Sequence[int]) -> FitResult:
    """The fit without some of the rows that were looked at."""
    campaign = whole.problem.campaign
    looked_at = thinned(campaign)
    keep = np.ones(campaign.n, dtype=bool)
    keep[np.array(aside) if looked_at is None else looked_at[list(aside)]] = False
    return fit(whole.model, campaign.rows(keep), near=True)


def _looked_at(whole: FitResult, given: Model | None, progress: Progress) -> Diagnosis:
    result = whole.thin
    if result.dof < 1:
        raise FitError(
            said(
                "the model's unknowns take up all that was measured ({rows}): nothing is left over "
                "that could be diagnosed; measure more",
                rows=counted(result.problem.n, "1 row", "{n} rows"),
            )
        )
    with threads_for(result.problem.n * result.problem.layout.size):
        return _diagnosed(given, whole, result, progress)


def _diagnosed(
    given: Model | None, whole: FitResult, result: FitResult, progress: Progress
) -> Diagnosis:
    model = result.model
    campaign = result.problem.campaign
    progress("enumerating candidates")
    basis = Basis.of(result)
    tried = acting_through(result, basis, candidates(model, campaign))

    def columns(candidate: Candidate, nonlinear: Mapping[str, float]) -> F64:
        at = candidate.at(result.theta)
        return result.problem.effect_columns(candidate.effect, nonlinear, at)

    frames = Frames(result.problem, result.theta, basis)
    clock = campaign.conditions.time
    pool = Pool(tried, columns, basis, model.machine, placed=frames.columns, time=clock)
    progress(f"testing {len(tried)} candidates")
    blocks = Blocks.of(campaign.conditions, model.machine)
    basis, chosen, ranked = foretelling(pool, basis, blocks)
    progress("looking for structure that is in no catalogue")
    patterns = Patterns(result.problem, result.theta, frames)
    chosen = chosen or reversals_described(pool, basis, patterns, blocks)
    found = {f.key for f in chosen}
    chosen, unexplained = compete(pool, basis, chosen, patterns, blocks)
    if any(f.key not in found for f in chosen):
        chosen = standing_beside(pool, basis, chosen, unexplained, blocks)
        unexplained = unexplained if chosen else patterns.established(basis)
    while chosen:
        together = standing_together(pool, _described(basis, rivals(unexplained, chosen)), chosen)
        if len(together) == len(chosen):
            break
        chosen = predicting(pool, basis, together, blocks)
        unexplained = patterns.established(pool.joined(basis, chosen))
    if not chosen and basis.share < 1.0:
        # no cause stands, so what is left is described as it is
        basis = replace(basis, share=1.0)
        unexplained = patterns.established(basis)
    progress("aliases and cross-validation")
    background = _described(basis, rivals(unexplained, chosen))
    after = pool.joined(background, chosen)
    variance = after.variance
    part = result.problem.n / whole.problem.n

    def reported(causes: Sequence[WeighedCandidate]) -> tuple[Established, ...]:
        return tuple(
            established_cause(pool, basis, background, result, f, causes, blocks, variance, part)
            for f in causes
        )

    established = reported(chosen)
    if given is not None and established:
        known = beside_which_it_holds(given, result, pool, background, established)
        established = established if known is None else reported(known)
    # what predicts best what was left out is offered first; the machine's before an instrument's
    # that nothing was measured without, and what can be before what no sound machine shows
    established = tuple(
        sorted(
            established,
            key=lambda e: (
                e.found.candidate.everywhere,
                not all(p.plausible for p in e.estimates),
                -e.cross_validated_gain,
            ),
        )
    )
    if whole is not result and established:
        progress("what was found, on all rows")
        established, left = on_all_rows(whole, result, established, pool.tried)
        variance = variance if unexplained else left
    large = [e for e in established if beyond_first_order(result, variance, [_valued(e)])]
    if large:
        # what was found beside them was found beside what the lever rule leaves out of them
        established, unexplained = tuple(large), []
    holds = None
    if given is not None:
        progress("what has changed")
        holds = standing(given, result, [pool.found_columns(e.found) for e in established])
    return Diagnosis(
        _verdict(holds, established, unexplained),
        whole,
        result,
        whole.rms(*measured_kinds(whole)),
        established,
        tuple(unexplained),
        tuple(ranked),
        variance,
        len(tried),
        pool,
        basis,
        holds,
        large_angles=bool(large),
    )


def _valued(established: Established) -> Valued:
    """An established cause with the values that it would have."""
    effect, nonlinear = established.effect, established.found.screened.nonlinear
    values = [e.value for e in established.estimates if e.name not in nonlinear]
    return effect, nonlinear, np.array(values)


def _described(basis: Basis, structure: Sequence[ResidualPattern]) -> Basis:
    """What a model leaves beside structure that is only described."""
    for s in structure:
        basis = basis.extended(s.columns)
    return basis


def _verdict(
    holds: Standing | None,
    established: Sequence[Established],
    unexplained: Sequence[ResidualPattern],
) -> Verdict:
    if holds is not None and (holds.changes or holds.suspicions):
        return "changed"
    if established:
        return "missing"
    return "unexplained" if unexplained else "complete"
