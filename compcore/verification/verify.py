"""The verification of a machine: lines before and after, what was foretold, what is proven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.decision_rule import Conformity
from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.artefacts.permissible import PermissibleError
from abbe.compcore.campaign.campaign import PART, Campaign, Kind
from abbe.compcore.comparison.compare import Comparison, compare
from abbe.compcore.errors import InputError, require_type
from abbe.compcore.fitting.design.superposition import compensated, predicted_rows
from abbe.compcore.iso230.positioning import positioning_runs
from abbe.compcore.model.model import Model
from abbe.compcore.verification.budget import MeasuringUncertainty
from abbe.compcore.verification.fitted import FittedPart, fitted_lines
from abbe.compcore.verification.foretold import ForetoldLine, foretold_line
from abbe.compcore.verification.lengths import (
    LengthsVerified,
    lengths_of_gauges,
    lengths_of_lines,
    lengths_verified,
)
from abbe.compcore.verification.line_test import LineTest, line_tests
from abbe.compcore.verification.placed import PlacedFigure, placed_figures
from abbe.compcore.verification.tolerance import JudgedFigure, Tolerance, judged_figures

F64 = NDArray[np.float64]

COVERAGE = 2.0


@dataclass(frozen=True, eq=False)
class VerificationRequest:
    """What a verification is asked.

    Attributes
    ----------
    before
        The same lines measured without compensation; None: worked out.
    bare
        Where a compensation was active, the campaign as the machine would have shown it without
        (`uncompensated`); None: none was active, unless `before` is given.
    fitted
        The campaigns that the model was fitted to, as far as they are at hand.
    tolerances, permissible
        What is stated: of figures of lines, of lengths (E0,MPE).
    sure
        How sure instrument, thermometers and set-up are.
    coverage
        The factor k of U = k·u.
    planned
        Set-ups of the check plan; only these and their parts (``01_laser.2``, after an
        interruption) count, and those that are missing are said. Empty: all of the campaign.
    whole
        Set-up of the check plan → rows that it has where all of it was measured in one go. One
        of which no part has so many is missing: between two zeros nobody knows what lies. Where a
        part has, those that were broken off do not count.
    """

    before: Campaign | None = None
    bare: Campaign | None = None
    fitted: Campaign | None = None
    tolerances: Sequence[Tolerance] = ()
    permissible: PermissibleError | None = None
    sure: MeasuringUncertainty = field(default_factory=MeasuringUncertainty)
    coverage: float = COVERAGE
    planned: Sequence[str] = ()
    whole: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class VerifiedLine:
    """One line, before and after.

    Attributes
    ----------
    before, after
        Without and with compensation; `before` None where nobody measured this line before.
    foretold
        What the model says of the line before; None likewise.
    fitted
        What of it the model was fitted to; None: it is new to the model.
    """

    before: LineTest | None
    after: LineTest
    foretold: ForetoldLine | None
    fitted: FittedPart | None


@dataclass(frozen=True, eq=False)
class Verification:
    """A machine judged by lines.

    Attributes
    ----------
    measured
        Whether the state after was measured; else it is computed: measured less foretold.
    before_measured
        Whether the state before was measured; else it is put back: measured and foretold.
    lines
        In the campaign's order.
    figures
        What is stated, line by line.
    lengths
        E0 after and before; None where no limit is stated.
    comparison
        The model beside what was measured before, or was put back.
    missing
        Set-ups of the check plan that were not measured, or not in one go.
    coverage
        The factor k.
    fitted_before
        Set-ups measured before to whose readings the model was fitted.
    left
        Where both states are of the same readings, what all of them show but for their zeros: of
        lengths and of angles, rms before, after, and a reading's standard uncertainty, mm or rad.
    placed
        Set-ups that are no lines, likewise: a ball bar, a sphere, an R-test, straightness, angles.
    same_gauges
        Whether the model was fitted to the same calibrated artefacts: what their calibration is
        wrong by is then in both.
    doubt
        Why it proves nothing all the same, by whoever had it judged; empty: nothing known.
    """

    measured: bool
    before_measured: bool
    lines: tuple[VerifiedLine, ...]
    figures: tuple[JudgedFigure, ...]
    lengths: LengthsVerified | None
    lengths_before: LengthsVerified | None
    comparison: Comparison
    missing: tuple[str, ...]
    coverage: float
    fitted_before: tuple[str, ...] = ()
    left: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    placed: tuple[PlacedFigure, ...] = ()
    same_gauges: bool = False
    doubt: str = ""

    @property
    def outcome(self) -> Conformity | None:
        """Of everything that is stated together; None where nothing is."""
        found = [f.outcome for f in self.figures]
        if self.lengths is not None:
            found.append(self.lengths.outcome)
        if not found:
            return None
        if Conformity.FAILS in found:
            return Conformity.FAILS
        if Conformity.NEITHER in found or self.missing:
            return Conformity.NEITHER
        return Conformity.PASSES


def verify(model: Model, campaign: Campaign, request: VerificationRequest) -> Verification:
    """Judge a machine by the lines of a campaign, before and after its compensation.

    Parameters
    ----------
    model
        The model by which it is compensated.
    campaign
        Measured with the compensation active where `request` has a campaign before it, or one put
        back; else without: then what is left is worked out.

    Raises
    ------
    InputError
        When the campaign has no line and no gauge, or a tolerance concerns none of them.
    """
    require_type(model, Model, "model")
    require_type(campaign, Campaign, "campaign")
    machine, sure = model.machine, request.sure
    parts = _parts(campaign, request.planned)
    missing = tuple(
        n for n in request.planned if max(parts[n].values(), default=0) < request.whole.get(n, 1)
    )
    bare = campaign if request.bare is None else request.bare
    if request.planned:
        present = [part for n in request.planned for part in _whole(parts[n], request.whole.get(n))]
        campaign, bare = _only(campaign, present), _only(bare, present)
    measured = request.bare is not None or request.before is not None
    corrected = campaign if measured else _corrected(campaign, model)
    after = line_tests(corrected, machine, sure)
    lengths = [*lengths_of_lines(after, sure), *lengths_of_gauges(corrected, machine, sure)]
    fitted = fitted_lines(campaign, model, request.fitted)
    earlier = bare if request.before is None else request.before
    before = line_tests(earlier, machine, sure)
    comparison = compare(model, earlier)
    judged = [one.setup for one in after]
    placed = tuple(placed_figures(model, campaign, comparison, judged, fitted, measured=measured))
    if not after and not lengths and not placed:
        raise InputError(
            "nothing that can be judged",
            found="set-ups " + ", ".join(campaign.setups),
            expected="rows along one axis or a diagonal with u along it, against a gauge, or more "
            "readings of a set-up than its placing leaves unknown",
        )
    lines = tuple(
        _line(model, one, _same(one, before, after), comparison, fitted.get(one.setup))
        for one in after
    )
    if request.permissible is not None and not lengths:
        raise InputError("no length that the limit could be held against", field="mpe")
    old_lengths = [*lengths_of_lines(before, sure), *lengths_of_gauges(earlier, machine, sure)]
    k = request.coverage
    pairs = [(v.before, v.after) for v in lines]
    figures = tuple(judged_figures(pairs, placed, request.tolerances, k, fitted))
    seen = bool(_rows(fitted))
    return Verification(
        measured,
        request.before is not None or not measured,
        lines,
        figures,
        _lengths(lengths, request, fitted=seen),
        _lengths(old_lengths, request, fitted=seen),
        comparison,
        missing,
        k,
        _rows(fitted_lines(earlier, model, request.fitted)) if request.before else (),
        {} if request.before else _left(comparison, campaign, model, measured=measured),
        placed,
        _same_gauges(campaign, request.fitted),
    )


def _same_gauges(campaign: Campaign, fitted: Campaign | None) -> bool:
    """Whether both have rows of an artefact of one name."""
    known = [set() if c is None or c.gauge is None else set(c.gauge) for c in (campaign, fitted)]
    return bool((known[0] & known[1]) - {""})


def _left(
    comparison: Comparison, campaign: Campaign, model: Model, *, measured: bool
) -> dict[str, tuple[float, float, float]]:
    """As `Verification.left`: what all readings show without and with compensation."""
    after = comparison.residual
    if measured:
        after = compare(replace(model, terms=(), covariance=None), campaign).measured
    turned = comparison.problem.campaign.kind == Kind.ROTATION
    found = {}
    for unit, rows in (("mm", ~turned), ("rad", turned)):
        if rows.any():
            sd = float(np.median(comparison.problem.sd[rows]))
            before, left = (
                float(np.sqrt(np.mean(v[rows] ** 2))) for v in (comparison.measured, after)
            )
            found[unit] = (before, left, sd)
    return found


def _rows(fitted: Mapping[str, FittedPart]) -> tuple[str, ...]:
    """Set-ups to whose very readings the model was fitted."""
    return tuple(name for name, part in fitted.items() if part is FittedPart.ROWS)


def _parts(campaign: Campaign, planned: Sequence[str]) -> dict[str, dict[str, int]]:
    """Planned set-up → its parts in a campaign, each with its number of rows."""
    setup = campaign.conditions.setup
    found: dict[str, dict[str, int]] = {name: {} for name in planned}
    for part in campaign.setups if setup is not None else ():
        name = part if part in found else part.partition(PART)[0]
        if name in found:
            found[name][part] = int(np.count_nonzero(setup == part))
    return found


def _whole(parts: Mapping[str, int], rows: int | None) -> list[str]:
    """The parts that were measured in one go; all of them where none was."""
    return [p for p, n in parts.items() if rows is None or n >= rows] or list(parts)


def _only(campaign: Campaign, names: Sequence[str]) -> Campaign:
    setup = campaign.conditions.setup
    if setup is None or not names:
        raise InputError(
            "nothing of the check plan was measured",
            field="setup",
            found=", ".join(campaign.setups),
            expected="set-ups with the plan's names",
        )
    return campaign.rows(np.isin(setup, list(names)))


def _corrected(campaign: Campaign, model: Model) -> Campaign:
    """What the machine would have shown, compensated: also its rotary axes' own positions."""
    found = compensated(campaign, model)
    turned = [r.setup for r in positioning_runs(campaign, model.machine) if r.unit == "rad"]
    setup = campaign.conditions.setup
    if not turned or setup is None:
        return found
    own = np.isin(setup, turned)
    taken = np.where(own, predicted_rows(campaign, model), 0.0)
    return replace(found, value=found.value - taken)


def _same(one: LineTest, others: Sequence[LineTest], beside: Sequence[LineTest]) -> LineTest | None:
    """The same line in another campaign: of the same set-up, else the only one of its name."""
    alike = [t for t in others if t.name == one.name]
    named = [t for t in alike if t.setup == one.setup]
    if named:
        return named[0]
    alone = sum(t.name == one.name for t in beside) == 1
    return alike[0] if len(alike) == 1 and alone else None


def _line(
    model: Model,
    after: LineTest,
    before: LineTest | None,
    comparison: Comparison,
    fitted: FittedPart | None,
) -> VerifiedLine:
    told = None if before is None else foretold_line(model, comparison, before)
    return VerifiedLine(before, after, told, fitted)


def _lengths(
    lengths: Sequence[MeasuredLength], request: VerificationRequest, *, fitted: bool
) -> LengthsVerified | None:
    if request.permissible is None or not lengths:
        return None
    found = lengths_verified(lengths, request.permissible, request.coverage)
    # readings to which the model was fitted prove nothing
    hollow = fitted and found.outcome is Conformity.PASSES
    return replace(found, outcome=Conformity.NEITHER) if hollow else found
