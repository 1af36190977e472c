"""The steps from a model to the verdict of its diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.diagnosis.findings import measured_kinds
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.strays import Stray
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult


@dataclass(frozen=True, eq=False)
class Step:
    """One change of the model.

    Attributes
    ----------
    action
        ``began``, ``added``, ``added together`` (with the next, as neither predicts anything
        alone), ``added with the others`` (error motions that every axis has, all at once),
        ``lagged`` (its signals stand behind a lag now), ``second body`` (behind the same
        signal), ``began elsewhere`` (than in equilibrium with its signal), ``described`` (by what
        explains nothing), ``removed``, ``set aside`` (readings that stand alone), ``composed``
        (errors in full, no longer by the lever rule), ``held near 0`` (cautious values, as curves
        ran away where nobody measured), ``went back`` (to the step that predicts left-out blocks
        best), ``kept from before`` (what this campaign does not show, as
        the earlier ones of the given model showed it).
    effect
        The effect that was added, changed or taken out; None for the beginning and for readings.
    result
        The fit with it.
    held_out
        How left-out blocks are predicted.
    strays
        The readings that were set aside.
    """

    action: str
    effect: Effect | None
    result: FitResult
    held_out: LeftOutErrors
    strays: tuple[Stray, ...] = ()

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """What its error is stated in: lengths, or rotations where there is nothing else."""
        return measured_kinds(self.result)

    @property
    def of_rotations(self) -> bool:
        """Whether its error is stated as rotations."""
        return self.kinds == (Kind.ROTATION,)


@dataclass(frozen=True, eq=False)
class Course:
    """All steps from a model to the verdict.

    Attributes
    ----------
    steps
        The first is the model as it was given, fitted.
    refused
        Effects that a diagnosis proposed and that were not taken.
    diagnosis
        Of the last model.
    spoiling
        Effects, or sets of them, with which the held-out campaign is predicted worse.
    why
        Spec of each refused effect → why, in words that follow *not kept,*.
    """

    steps: tuple[Step, ...]
    refused: tuple[Effect, ...]
    diagnosis: Diagnosis
    spoiling: tuple[tuple[Effect, ...], ...] = ()
    why: Mapping[str, str] = field(default_factory=dict)

    @property
    def last(self) -> Step:
        """The model that was reached."""
        return self.steps[-1]


def leaves_noise(result: FitResult) -> bool:
    """Whether χ² is what noise makes it, to its own standard deviation: nothing to describe."""
    thin = result.thin
    return not thin.uncertainty.open and thin.chi2 <= thin.dof + math.sqrt(2.0 * thin.dof)
