"""Explanations in a metrologist's words: what, how much, where in the data, what to do."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.diagnosis.changed import Change, Standing
from abbe.compcore.diagnosis.findings import Established, Findings
from abbe.compcore.diagnosis.hidden_waves import hidden_waves
from abbe.compcore.diagnosis.judging.aliases import Alias
from abbe.compcore.diagnosis.screening.levers import grows, shift_of
from abbe.compcore.diagnosis.screening.parameters import Estimate
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import ResidualPattern
from abbe.compcore.effects import RotaryLocation, SpindleLocation
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.registry import effect_kinds
from abbe.compcore.model.as_built import average_lines, seen_factor
from abbe.compcore.model.held_spindle import where_they_are
from abbe.compcore.model.late_thermometers import late_words
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.sentences import Sentence, joined, said
from abbe.compcore.units import in_digits, read_in, with_uncertainty

F64 = NDArray[np.float64]

_MOST_SETUPS = 3
_MOST_CHANGED = 3
_SHOWN = 4
_SHOWS = 0.005
"""Part of the variance of left-out blocks below which it would be shown as 0 %."""
_NAMED = 6
"""An effect of more parameters is a shape, of which no single one says anything."""


def explanation(established: Established, diagnosis: Findings) -> Sentence:
    """A paragraph: what it is, the evidence, the parameters, cause and cure, the expected error."""
    return joined(explained(established, diagnosis), " ")


def explained(established: Established, diagnosis: Findings) -> list[Sentence]:
    """The parts of an explanation, each of one purpose."""
    effect = established.found.candidate.effect
    campaign = diagnosis.result.problem.campaign
    what = said("{what}.", what=headline(effect))
    values = [
        *_fitted(established.estimates),
        *hidden_waves(
            effect, established.found.screened.nonlinear, diagnosis.result.model.machine,
            campaign.conditions,
        ),
        *_as_built(established, diagnosis),
    ]  # fmt: skip
    parts = [joined([what, _evidence(established, diagnosis, campaign)], " ")]
    parts += [joined(values, " ")] if values else []
    machine = diagnosis.result.model.machine
    estimated = {e.name: (e.value, e.sd) for e in established.estimates}
    late = late_words(effect, machine, estimated)
    parts += doubts_of(established.estimates) if late is None else [said("{what}.", what=late)]
    if names := _alternatives([a for a in established.aliases if not a.told_apart]):
        parts.append(said("This campaign cannot tell it from: {names}.", names="; ".join(names)))
    if names := _alternatives([a for a in established.aliases if a.told_apart]):
        parts.append(said(
            "As much is explained by: {names}; it would show elsewhere, so both may have a part "
            "in it.",
            names="; ".join(names),
        ))  # fmt: skip
    parts += _deciding(effect, established.aliases)
    if late is None and (cause := section(effect, "Typical causes")):
        parts.append(said("Typical causes: {causes}", causes=_of_page(_sentence(cause))))
    if late is None and (cure := section(effect, "Cure")):
        parts.append(said("Cure: {cure}", cure=_of_page(_sentence(cure))))
    if effect.scope == "instrument":
        parts.append(said("It belongs to the instrument and never goes into the compensation."))
    return [*parts, gain_of(established, diagnosis)]


def gain_of(established: Established, diagnosis: Findings) -> Sentence:
    """What adding a cause does to the residuals."""
    unit, _, factor = diagnosis.unit
    before, after = diagnosis.rms * factor, established.rms_after * factor
    return said(
        "Added, it brings the residuals from {before} to {after} {unit} RMS.",
        before=f"{before:.2f}",
        after=f"{after:.2f}",
        unit=unit,
    )


def _alternatives(aliases: Sequence[Alias]) -> list[str]:
    """Specs of what else it could be, the likeliest of each kind first, `_SHOWN` at the most."""
    effects = [a.found.candidate.effect for a in aliases]
    first = {e.kind: e for e in reversed(effects)}
    own = [e for e in effects if first[e.kind] is e]
    return [e.spec for e in (own + [e for e in effects if e not in own])[:_SHOWN]]


def _deciding(shift: Effect, aliases: Sequence[Alias]) -> list[Sentence]:
    """Where a growth or a lean shows that one place, or one lever, does not tell from a shift."""
    others = [a.found.candidate.effect for a in aliases if shift.signals_needed()]
    others = [e for e in others if shift_of(shift, e)]
    axes = sorted({e.where()["axis"] for e in others if grows(e)})
    parts = [
        said(
            "Warm at another {axis} decides: a shift is the same everywhere, a growth is not.",
            axis=axis,
        )
        for axis in axes
    ]
    if any(not grows(e) for e in others):
        parts.append(said(
            "Warm with a tool of another length decides: a shift stays the same, a lean does not."
        ))  # fmt: skip
    return parts


def doubts_of(estimates: Sequence[Estimate]) -> list[Sentence]:
    """Which parameters no sound machine shows, one sentence each; none where all are plausible."""
    return [
        said(
            "{name} lies outside what a sound machine shows ({least} … {greatest}): look for a "
            "wrong unit or another cause.",
            name=e.name,
            least=amount(e.range[0], e),
            greatest=amount(e.range[1], e),
        )
        for e in estimates
        if not e.plausible
    ]


def _fitted(estimates: Sequence[Estimate]) -> list[str]:
    """What the campaign says of the parameters, of which of them nothing; of a shape none."""
    if len(estimates) > _NAMED:
        return []
    measured = [e for e in estimates if e.measured]
    silent = [e.name for e in estimates if not e.measured]
    parts: list[str] = []
    if measured:
        if len(measured) > _SHOWN:
            # a period or a lag says what it is: never among those that are not shown
            measured.sort(key=lambda e: not e.searched)
        shown = _first([parameter(e) for e in measured])
        parts.append(said("Fitted: {parameters}.", parameters=shown))
    if measured and silent:
        parts.append(said("This campaign says nothing of {names}.", names=_first(silent)))
    return parts


def _first(names: Sequence[str]) -> str:
    """The first ones of many, and how many more there are."""
    shown = ", ".join(names[:_SHOWN])
    more = len(names) - _SHOWN
    return said("{shown} and {n} more", shown=shown, n=more) if more > 0 else shown


TO_ENTER = said("What to enter for it in the controller is said once it is added and fitted.")
"""Beside a place that further causes may still move."""


def _as_built(established: Established, diagnosis: Findings) -> list[str]:
    """What is physically there: of a rotary axis's line, of a table itself."""
    effect, model = established.found.candidate.effect, diagnosis.result.problem.model
    if isinstance(effect, RotaryLocation | SpindleLocation):
        # where one lies counts from where the others are; what is entered for it also from those
        # that are still to be found
        found = {e.found.candidate.effect: e for e in diagnosis.established}
        beside = tuple(t for t in model.terms if t.effect not in found)
        terms = (Term(e, _estimated(one)) for e, one in found.items())
        whole = Model(model.machine, (*beside, *terms))
        lines = average_lines(where_they_are(whole))
        lies = [
            w
            for one in lines
            if isinstance(effect, RotaryLocation) and one.axis == effect.axis
            for w in one.words(entering=False)
        ]
        there = [said("Where it is: {what}.", what=joined(lies))] if lies else []
        return [*there, TO_ENTER]
    if seen_factor(model.machine, effect) > 0.0:
        return []
    return [said("On the table itself (level, indicator, R-test) it has the opposite sign.")]


def _estimated(established: Established) -> dict[str, Value]:
    return {e.name: Value(e.value, e.sd, e.measured) for e in established.estimates}


def _evidence(established: Established, diagnosis: Findings, campaign: Campaign) -> str:
    found = established.found
    unit, _, factor = diagnosis.unit
    shown = campaign.kind == (Kind.ROTATION if diagnosis.of_rotations else Kind.DISPLACEMENT)
    # beside other causes its signature is also what these would be otherwise, where it does nothing
    acts = np.abs(diagnosis.pool.found_columns(found)).max(axis=1) > 0.0
    signature = np.where(acts, established.signature, 0.0)
    largest = float(np.abs(signature[shown]).max()) * factor if shown.any() else 0.0
    fall, coefficients = f"{found.evidence.f_drop:.0f}", _columns(found.screened.rank)
    chance = _chance(found.evidence.log_p)
    parts: list[str] = [
        said(
            "Of the {n} candidates tested it explains the residuals best: χ² falls by {fall} for "
            "{coefficients} ({chance})",
            n=diagnosis.tests,
            fall=fall,
            coefficients=coefficients,
            chance=chance,
        )
        if len(diagnosis.established) == 1
        else said(
            "Beside the other causes found, of {n} candidates tested, it lets χ² fall by {fall} "
            "for {coefficients} ({chance})",
            n=diagnosis.tests,
            fall=fall,
            coefficients=coefficients,
            chance=chance,
        )
    ]
    if largest > 0.0:
        parts.append(said(", up to {size} {unit}", size=f"{largest:.1f}", unit=unit))
    if places := _where(signature, campaign, diagnosis):
        parts.append(said(", most of it in {places}", places=places))
    gain = established.cross_validated_gain
    if gain >= _SHOWS:
        less = f"{gain:.0%}"
        parts.append(
            said("; blocks left out of the fit are predicted with {less} less variance.", less=less)
        )
    else:
        parts.append(said("; blocks left out of the fit are not predicted better."))
    return joined(parts, "")


def _columns(rank: int) -> str:
    return said("one coefficient") if rank == 1 else said("{n} coefficients", n=rank)


_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def _chance(log_p: float) -> str:
    """How unlikely, from its natural logarithm.

    >>> print(_chance(-46.05))
    chance: 1 in 10²⁰
    """
    power = log_p / np.log(10.0)
    if power < -99:
        return said("chance: less than 1 in 10⁹⁹")
    return said("chance: 1 in 10{power}", power=f"{-power:.0f}".translate(_RAISED))


def _where(signature: F64, campaign: Campaign, diagnosis: Findings) -> str:
    setup = campaign.conditions.setup
    if setup is None:
        return ""
    weighted = (signature * diagnosis.result.problem.weight) ** 2
    names, inverse = np.unique(setup, return_inverse=True)
    share = np.bincount(inverse.reshape(-1), weights=weighted)
    order = np.argsort(-share)[:_MOST_SETUPS]
    return ", ".join(str(names[i]) for i in order if share[i] > 0.0)


_KEYS = {
    "axis": said("axis"),
    "error": said("error"),
    "along": said("along"),
    "across": said("across"),
    "axes": said("axes"),
    "base": said("base"),
    "by": said("by"),
    "file": said("file"),
    "harmonics": said("harmonics"),
    "measures": said("measures"),
    "number": said("number"),
    "period": said("period"),
    "positions": said("positions"),
    "setups": said("setups"),
    "shape": said("shape"),
    "tool": said("tool"),
    "about": said("about"),
    "direction": said("direction"),
    "signal": said("signal"),
    "signals": said("signals"),
    "setup": said("setup"),
}
"""Where-keys in words that languages find."""


def _listed(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def headline(effect: Effect) -> str:
    """The first sentence of an effect's page, with the place."""
    first = _of_page(_first_sentence(type(effect)))
    parts = [
        said("{key} {value}", key=_KEYS.get(key, key), value=_listed(value))
        for key, value in effect.where().items()
    ]
    where = joined(parts, ", ") if len(parts) > 1 else next(iter(parts), "")
    return said("{what} ({where})", what=first, where=where) if where else first


def page_sentences() -> Iterator[str]:
    """What explanations take from the pages of all effects: what each is, its causes, its cure."""
    for cls in effect_kinds().values():
        yield _first_sentence(cls)
        for name in ("Typical causes", "Cure"):
            if text := _section(cls, name):
                yield _sentence(text)


def _of_page(text: str) -> str:
    """A sentence of an effect's page, which other languages have as it stands there."""
    return text if "{" in text else said(text)


def _first_sentence(cls: type[Effect]) -> str:
    first = inspect.cleandoc(cls.__doc__ or cls.__name__).split("\n\n")[0]
    return re.sub(r"\s+", " ", first).rstrip(".")


def section(effect: Effect, name: str) -> str:
    """One section of an effect's page as running text; empty where it has none."""
    return _section(type(effect), name)


def _section(cls: type[Effect], name: str) -> str:
    lines = inspect.cleandoc(cls.__doc__ or "").splitlines()
    found: list[str] = []
    inside = False
    for line in lines:
        if line.strip() == name and not line.startswith(" "):
            inside = True
        elif inside and line and not line.startswith(" "):
            break
        elif inside:
            found.append(line.strip())
    return re.sub(r"\s+", " ", " ".join(found)).strip()


def _sentence(text: str) -> str:
    """A sentence with a capital and a full stop, without a docstring's marks."""
    text = text.replace("``", "")
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")


def amount(value: float, of: Estimate) -> str:
    """A value of a parameter in the unit that people read: µm, µrad, ppm/K; a period in mm."""
    name, factor = read_in(of)
    return f"{in_digits(value * factor)} {name}"


def parameter(estimate: Estimate) -> str:
    """A parameter with its standard deviation, in the unit that people read."""
    name, factor = read_in(estimate)
    value = with_uncertainty(estimate.value * factor, estimate.sd * factor)
    return f"{estimate.name} = {value} {name}".rstrip()


def description(structure: ResidualPattern) -> str:
    """A pattern in words: how the residuals go, and on which error motion."""
    pattern = structure.pattern
    error_motion = str(pattern.error_motion)
    if error_motion.startswith("d"):
        place = said("the error of the functional point in {axis}", axis=error_motion[1:])
    else:
        place = said("the tilt {motion}", motion=error_motion)
    text = said("{place}: {form}", place=place, form=pattern.form)
    if pattern.depends_on == ("t",) and pattern.form.startswith("oscillation"):
        text = said("{pattern}, unrelated to any recorded signal", pattern=text)
    return text


def formula(structure: ResidualPattern) -> str | None:
    """What ``abbe add`` takes to add a pattern as an empirical formula; None where none says it."""
    pattern = structure.pattern
    if not pattern.terms:
        return None
    terms = ",".join(term.replace(" ", "") for term in pattern.terms)
    return f"formula channel={pattern.error_motion} terms={terms}"


def changed(standing: Standing) -> Iterator[str]:
    """What no longer holds of a model as it was given; what is suspicious first."""
    for suspicion in standing.suspicions:
        yield said("SUSPICIOUS: {what}", what=suspicion)
    for change in standing.changes:
        unit, factor = ("µrad", 1e6) if change.of_rotations else ("µm", 1e3)
        moved = _moved_parameters(change) if len(change.parameters) <= _NAMED else ""
        size = f"{in_digits(change.largest * factor)} {unit}"
        how = said("up to {size} in this campaign", size=size)
        if moved:
            how = joined([moved, how], ", ")
        spec = change.effect.spec
        if standing.since:
            text = said(
                "{spec} changed since {date}: {how}", spec=spec, date=standing.since, how=how
            )
        elif standing.fitted:
            text = said(
                "{spec} changed (against the model of {date}): {how}",
                spec=spec, date=standing.fitted, how=how,
            )  # fmt: skip
        else:
            text = said("{spec} changed: {how}", spec=spec, how=how)
        if change.aliases:
            text = said(
                "{change}; this campaign cannot tell it from a change of {others}",
                change=text, others="; ".join(change.aliases),
            )  # fmt: skip
        yield text
    if standing.changes and standing.else_holds:
        yield said("everything else of the model holds")
    elif standing.changes:
        yield said("and more than these has changed: fit the whole model again")


def _moved_parameters(change: Change) -> str:
    """The parameters that moved by more than their uncertainty, the surest first."""
    sure = [p for p in change.parameters if abs(p.by) > p.sd]
    sure.sort(key=lambda p: -abs(p.by) / max(p.sd, 1e-300))
    moved = []
    for p in sure[:_MOST_CHANGED]:
        unit, factor = read_in(p)
        by = with_uncertainty(p.by * factor, p.sd * factor)
        moved.append(
            said(
                "{name} by {change} (from {before} to {after})",
                name=p.name, change=f"{'' if p.by < 0.0 else '+'}{by} {unit}",
                before=in_digits(p.before * factor, 4), after=in_digits(p.after * factor, 4),
            )
        )  # fmt: skip
    return joined(moved, ", ") if moved else ""
