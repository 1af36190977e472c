"""What a diagnosis finds: causes that are established, structure that is left, all candidates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.diagnosis.changed import Standing
from abbe.compcore.diagnosis.judging.aliases import Alias
from abbe.compcore.diagnosis.mistaken import Mistake
from abbe.compcore.diagnosis.screening.parameters import Estimate
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.strays import Stray
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import ResidualPattern
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult

F64 = NDArray[np.float64]

Verdict = Literal["complete", "missing", "unexplained", "changed"]


@dataclass(frozen=True, eq=False)
class Established:
    """A cause that the data establish.

    Attributes
    ----------
    found
        The candidate and its evidence, beside the other established causes.
    estimates
        Its parameters with standard deviations and plausibility.
    rms_after
        RMS of the residuals of lengths if it alone were added, mm; of rotations, rad, where the
        campaign has nothing else.
    cross_validated_gain
        Part of the variance of unseen set-ups that it removes.
    aliases
        What this campaign cannot tell from it, the likeliest first.
    signature
        What it explains in each row beyond what the model, with the other established causes, can
        imitate, (n,), mm or rad.
    beside_others
        What the model with the other established causes leaves in each row, (n,), mm or rad; NaN
        where a row was not used.
    """

    found: WeighedCandidate
    estimates: tuple[Estimate, ...]
    rms_after: float
    cross_validated_gain: float
    aliases: tuple[Alias, ...]
    signature: F64
    beside_others: F64

    @property
    def effect(self) -> Effect:
        """The effect that is missing; `add_effect` takes it."""
        return self.found.candidate.effect


@dataclass(frozen=True, eq=False, repr=False)
class Findings:
    """What was found out about a model, by a campaign.

    Attributes
    ----------
    verdict
        ``changed`` where effects of the model as it was given no longer hold; else ``complete``,
        ``missing`` or ``unexplained``.
    whole
        The fit of the model as it is to all rows.
    result
        The same fit on the rows on which candidates were tested: all, or some of a large campaign
        (`abbe.compcore.campaign.thinning`).
    rms
        RMS of the residuals of lengths of all rows, mm; of rotations, rad, where the campaign has
        nothing else.
    established
        Causes, the first to add first.
    structure
        Descriptions of what no cause explains, strongest first.
    ranked
        All candidates against the model as it is, strongest evidence first.
    left
        χ² per degree of freedom once the established causes are added.
    tests
        Number of candidates tested.
    pool, basis
        For further questions: the candidates' columns, what the model leaves.
    standing
        Whether the model as it was given holds, and what has changed; None where it was not fitted.
    strays
        Readings that stand alone, and were left out of all this.
    large_angles
        Whether the causes turn something so far that errors no longer add up; what else is missing
        was then not asked.
    mistakes
        What the campaign's writer seems to have mistaken: asked first of all.
    """

    verdict: Verdict
    whole: FitResult
    result: FitResult
    rms: float
    established: tuple[Established, ...]
    structure: tuple[ResidualPattern, ...]
    ranked: tuple[WeighedCandidate, ...]
    left: float
    tests: int
    pool: Pool = field(repr=False)
    basis: Basis = field(repr=False)
    standing: Standing | None = None
    strays: tuple[Stray, ...] = ()
    large_angles: bool = False
    mistakes: tuple[Mistake, ...] = ()

    @property
    def of_rotations(self) -> bool:
        """Whether `rms` is of rotations, rad."""
        return measured_kinds(self.whole) == (Kind.ROTATION,)

    @property
    def unit(self) -> tuple[str, str, float]:
        """The unit of residuals, in words and in JSON, and its factor: µm or µrad."""
        return ("µrad", "urad", 1e6) if self.of_rotations else ("µm", "um", 1e3)


def measured_kinds(result: FitResult) -> tuple[Kind, ...]:
    """What a campaign's error is stated in: lengths, or rotations where it has nothing else."""
    kinds = result.problem.campaign.kind
    return LENGTHS if bool(np.isin(kinds, LENGTHS).any()) else (Kind.ROTATION,)
