"""What a check says where no tolerance is stated: better than before, not proven, or worse."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from abbe.compcore.artefacts.decision_rule import Conformity
from abbe.compcore.sentences import joined, said
from abbe.compcore.units import display, in_digits, with_uncertainty
from abbe.compcore.verification.fitted import FittedPart
from abbe.compcore.verification.placed import PlacedFigure
from abbe.compcore.verification.verify import Verification, VerifiedLine

_FIGURE = "E"
"""What is compared: it wants no repeated runs, and holds systematic errors and play."""
_MORE = 1.05
"""What all readings together have to grow by, beyond a reading's uncertainty, to be worse."""


class VerdictOutcome(Enum):
    """How a check of a calibration came out."""

    VERIFIED = "verified"
    OPEN = "not verified"
    WORSE = "worse"


_OUTCOMES = {
    VerdictOutcome.VERIFIED: said("verified"),
    VerdictOutcome.OPEN: said("not verified"),
    VerdictOutcome.WORSE: said("worse"),
}


@dataclass(frozen=True)
class CheckVerdict:
    """How a check came out, and why.

    Attributes
    ----------
    outcome
        ``WORSE``: a line is worse after than before by more than its uncertainty, or a tolerance is
        surely not kept. ``OPEN``: nothing of the kind, but something lacks. Else ``VERIFIED``.
    reasons
        In sentences, the gravest first; of ``VERIFIED`` what the lines have become.
    """

    outcome: VerdictOutcome
    reasons: tuple[str, ...]

    @property
    def text(self) -> str:
        """One line for people."""
        outcome = _OUTCOMES[self.outcome]
        return said("{outcome}: {why}", outcome=outcome, why=joined(self.reasons))


def check_verdict(found: Verification) -> CheckVerdict:
    """Judge a check by what was before it, by what the model foretold, by what is stated."""
    worse = [_words(v, found.coverage) for v in found.lines if _is_worse(v, found.coverage)]
    worse += [_worse_words(p, found.coverage) for p in found.placed if p.worse]
    worse += _all_worse(found)
    if found.outcome is Conformity.FAILS:
        worse.append(said("a stated tolerance is not kept"))
    if worse:
        return CheckVerdict(VerdictOutcome.WORSE, tuple(worse))
    if lacking := tuple(_lacking(found)):
        return CheckVerdict(VerdictOutcome.OPEN, lacking)
    return CheckVerdict(VerdictOutcome.VERIFIED, tuple(_greatest(found)))


def _is_worse(line: VerifiedLine, coverage: float) -> bool:
    before = None if line.before is None else line.before.value(_FIGURE)
    after, sd = line.after.value(_FIGURE), line.after.sd(_FIGURE)
    if before is None or after is None or sd is None:
        return False
    return after > before + coverage * sd


def _all_worse(found: Verification) -> Iterator[str]:
    """What all readings together are worse by, also those that are of no line."""
    for unit, (before, after, sd) in found.left.items():
        if after > _MORE * before and after**2 > before**2 + sd**2:
            yield _all_readings(unit, before, after)


def _all_readings(unit: str, before: float, after: float) -> str:
    shown, factor = display(unit)
    return said(
        "all readings: {before} before, {after} rms after",
        before=in_digits(before * factor), after=f"{in_digits(after * factor)} {shown}",
    )  # fmt: skip


def _lacking(found: Verification) -> Iterator[str]:
    """What keeps a check that is not worse from proving anything."""
    if found.doubt:
        yield found.doubt
    if found.missing:
        yield said("not measured in one go: {setups}", setups=", ".join(found.missing))
    fitted = [v.after.setup for v in found.lines if v.fitted is FittedPart.ROWS]
    fitted += [p.setup for p in found.placed if p.fitted is FittedPart.ROWS]
    if fitted:
        names = ", ".join(fitted)
        yield said("the model was fitted to these very readings: {setups}", setups=names)
    against = [v.after.setup for v in found.lines if v.foretold and v.foretold.agrees is False]
    against += [p.setup for p in found.placed if p.agrees is False]
    if against:
        yield said(
            "the model does not foretell {setups} within both uncertainties",
            setups=", ".join(against),
        )
    known = [v for v in found.lines if v.foretold and v.foretold.agrees is not None]
    if not known and all(p.agrees is None for p in found.placed):
        yield said("nothing says how sure the model's word of these lines is")
    if not found.lines and _hidden(found):
        yield said("what the readings are unsure by is more than what they showed before")
    if found.outcome is Conformity.NEITHER:
        yield said("a stated tolerance is neither kept nor broken for sure")


def _hidden(found: Verification) -> bool:
    """Whether all ranges before lie within their own uncertainty: such ranges prove nothing."""
    known = [(p.before, found.coverage * p.sd) for p in found.placed if p.before is not None]
    return bool(known) and all(before <= unsure for before, unsure in known)


def _greatest(found: Verification) -> Iterator[str]:
    """The greatest E of lengths and of angles, before and after; of lengths alone all readings."""
    judged = False
    for rotary in (False, True):
        alike = [v for v in found.lines if v.after.rotary is rotary and v.before is not None]
        seen = [v for v in alike if v.after.value(_FIGURE) is not None]
        judged |= bool(seen)
        if seen:
            yield _words(max(seen, key=lambda v: v.after.value(_FIGURE) or 0.0), found.coverage)
    if not found.lines:
        yield from (_placed_words(p, found.coverage) for p in found.placed)
        if found.placed:
            yield said("no line was measured: the axes over their travels are not shown")
    if not judged and not found.placed:
        for unit, (before, after, _) in found.left.items():
            yield _all_readings(unit, before, after)
    if found.same_gauges:
        yield said(
            "the model was fitted to the same artefact: what its calibration is wrong by is in both"
        )


def _words(line: VerifiedLine, coverage: float) -> str:
    """``02_laser X: E 52.0 ± 1.6 before, 9.0 ± 1.6 µm after``."""
    factor, unit = (1e6, "µrad") if line.after.rotary else (1e3, "µm")

    def shown(value: float | None, sd: float | None) -> str:
        if value is None or sd is None:
            return "–"
        return with_uncertainty(value * factor, coverage * sd * factor)

    after = shown(line.after.value(_FIGURE), line.after.sd(_FIGURE))
    before = "–"
    if line.before is not None:
        before = shown(line.before.value(_FIGURE), line.before.sd(_FIGURE))
    return said(
        "{line}: E {before} before, {after} after",
        line=f"{line.after.name} {line.after.setup}", before=before, after=f"{after} {unit}",
    )  # fmt: skip


def _worse_words(one: PlacedFigure, coverage: float) -> str:
    """Its range where that has grown; else ``bar: all its readings 5.2 before, 9.0 µm after``."""
    if one.before is not None and one.after > one.before + coverage * one.sd:
        return _placed_words(one, coverage)
    factor, unit = (1e6, "µrad") if one.unit == "rad" else (1e3, "µm")
    return said(
        "{setup}: all its readings {before} before, {after} rms after",
        setup=one.setup, before=in_digits((one.rms_before or 0.0) * factor),
        after=f"{in_digits(one.rms_after * factor)} {unit}",
    )  # fmt: skip


def _placed_words(one: PlacedFigure, coverage: float) -> str:
    """``bar: range 52.0 ± 1.6 before, 9.0 ± 1.6 µm after``."""
    factor, unit = (1e6, "µrad") if one.unit == "rad" else (1e3, "µm")
    before, after = (
        "–" if v is None else with_uncertainty(v * factor, coverage * one.sd * factor)
        for v in (one.before, one.after)
    )
    return said(
        "{setup}: range {before} before, {after} after",
        setup=one.setup, before=before, after=f"{after} {unit}",
    )  # fmt: skip
