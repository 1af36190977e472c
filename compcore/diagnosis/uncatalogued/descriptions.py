"""What a spreadsheet would do where no cause is left: a curve, a short formula, a polynomial.

No evidence is asked of a description, and it names no cause: it is taken for what it foretells of
left-out blocks alone. So nobody ends worse than with a table of the axis's own positions, however
alike the rows are that no cause explains.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.explain import formula
from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.judging.foretelling import WORTH
from abbe.compcore.diagnosis.screening.left_out.crossvalidation import FOLDS, LeftOut
from abbe.compcore.diagnosis.uncatalogued.over_the_volume import smooth_errors
from abbe.compcore.distributions import log_f_beyond, signed_rank_beyond
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.formula import Formula
from abbe.compcore.effects.catalogue.linear.linear_axes import Positioning
from abbe.compcore.effects.catalogue.linear.reversal import Backlash
from abbe.compcore.effects.catalogue.rotary.motions import RotaryPositioning
from abbe.compcore.effects.shapes import CUBIC
from abbe.compcore.fitting.detail import finer, no_finer_than_seen
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import identity

F64 = NDArray[np.float64]

Own = Positioning | RotaryPositioning | Backlash
"""What a table of an axis's own positions says."""

LEAST = 0.1
"""Part of the left-out χ² that a description removes where it need not be surer than one chance."""

_CHANCE = 0.05
"""Chance of so large a mean fall over the blocks by their scatter alone: Student's t, one side."""

_ENOUGH = 4
"""Blocks of which the scatter says something by itself."""


def descriptions(diagnosis: Findings) -> Iterator[tuple[Effect, ...]]:
    """The descriptions that a model may be given, those of an axis's own position first.

    Each is one effect, or one for every direction that belong together.
    """
    model, campaign = diagnosis.result.model, diagnosis.result.problem.campaign
    coverage = campaign.coverage()
    axes = [a for a in model.machine.structure.axes if a in coverage.moving]
    if len(campaign.setups) < FOLDS:
        for axis in axes:
            rotary = model.machine.axis(axis).rotary
            waves = RotaryPositioning(axis=axis)
            own: list[Own] = [waves.held_beyond(model.machine.axis(axis), coverage.ends.get(axis))]
            if not rotary:
                usual = Positioning(axis=axis)
                own = [no_finer_than_seen(usual, campaign.conditions, model.machine)]
            if axis in coverage.reversing:
                own.append(Backlash(axis=axis))
            for plain in own:
                for effect in _known(model, plain):
                    yield (effect,)
                    for detail in finer(effect, campaign.conditions, model.machine):
                        yield (effect.model_copy(update=detail),)
            if len(own) > 1:
                yield from _each_direction(model, own, campaign.conditions)
    for structure in diagnosis.structure:
        # what goes with time says nothing of another day
        if "t" not in structure.depends_on and (spec := formula(structure)) is not None:
            channel, terms = spec.removeprefix("formula channel=").split(" terms=", 1)
            yield (Formula.model_validate({"channel": channel, "terms": terms}),)
    yield from smooth_errors(model.machine, campaign)


def _each_direction(
    model: Model, own: Sequence[Own], conditions: Conditions
) -> Iterator[tuple[Effect, ...]]:
    """What a table of each direction says (ISO 230-2): a mean curve, and play over the travel.

    Each alone may foretell nothing where the two ways differ otherwise at every target.
    """
    mean, play = (_known(model, effect)[0] for effect in own)
    coarse = play.model_copy(update={"shape": f"spline:{CUBIC + 1}", "positions": ()})
    shapes: list[dict[str, object]] = [
        {"shape": coarse.shape},
        *finer(coarse, conditions, model.machine),
    ]
    for detail in ({"positions": ()} | shape for shape in shapes):
        if not isinstance(mean, RotaryPositioning):
            yield (mean.model_copy(update=detail), play.model_copy(update=detail))
        elif detail["shape"] != "table":
            yield (mean, play.model_copy(update=detail))
        else:
            of_mean = detail | {"harmonics": None}
            yield (mean.model_copy(update=of_mean), play.model_copy(update=detail))


def _known(model: Model, plain: Own) -> list[Own]:
    """An effect in the detail that a model has it in; as it is, where the model lacks it."""
    found = [e for e in model.effects if identity(e) == identity(plain)]
    return [e for e in found if isinstance(e, type(plain))] or [plain]


def surely(before: LeftOut, after: LeftOut, weight: F64, *, chances: int = 1) -> bool:
    """Whether left-out blocks are foretold better by more than their own scatter.

    Few blocks, a run each way, are cut into stretches for that: each place was foretold.

    Parameters
    ----------
    before, after
        What two models leave of the same rows in the same blocks, mm or rad, shape (n,).
    weight
        One over the rows' standard uncertainties, 1/mm or 1/rad, shape (n,): lengths and rotations
        count alike.
    chances
        Among how many different descriptions the one was chosen (Bonferroni).
    """
    fall = np.array(
        [
            float(np.sum((before.residual[rows] * weight[rows]) ** 2))
            - float(np.sum((after.residual[rows] * weight[rows]) ** 2))
            for rows in _stretches(before.folds)
        ]
    )
    if len(fall) < 2 or not fall.mean() > 0.0:
        return False
    squared = len(fall) * fall.mean() ** 2 / max(float(fall.var(ddof=1)), 1e-300)
    by_size = log_f_beyond(float(squared), 1, len(fall) - 1) < math.log(2.0 * _CHANCE / chances)
    # of blocks with few rows and with many, the many alone would make the scatter
    return by_size or signed_rank_beyond(fall) < _CHANCE / chances


def _stretches(folds: Sequence[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """The blocks; two or three are cut into `FOLDS` stretches, each of several rows."""
    pieces = 1 if len(folds) >= _ENOUGH else math.ceil(FOLDS / max(1, len(folds)))
    return [p for r in folds for p in np.array_split(r, max(1, min(pieces, len(r) // 2)))]


def taken(fall: float, before: LeftOut, after: LeftOut, weight: F64, chances: int) -> bool:
    """Whether a description foretells left-out blocks so much better that it is taken.

    Either it removes much of their χ², or what a cause has to remove, but so surely that its having
    been chosen among others does not matter: a bent plate's small cubic is in every block.

    Parameters
    ----------
    fall
        Part of the left-out χ² that it removes.
    before, after, weight
        As `surely`.
    chances
        How many different descriptions there were.
    """
    if fall >= LEAST:
        return surely(before, after, weight)
    return fall >= WORTH and surely(before, after, weight, chances=chances)


def different(found: Sequence[Sequence[Effect]]) -> int:
    """How many descriptions differ in more than how fine they are."""
    return len(
        {
            tuple((e.kind, getattr(e, "axis", ""), getattr(e, "channel", "")) for e in effects)
            for effects in found
        }
    )
