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
from abbe.compcore.diagnosis.screening.parameters import Estimate
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import ResidualPattern
from abbe.compcore.effects import RotaryLocation
from abbe.compcore.effects.base import Effect
from abbe.compcore.model.as_built import average_lines, seen_factor
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.units import display, in_digits, with_uncertainty

F64 = NDArray[np.float64]

_MOST_SETUPS = 3
_MOST_CHANGED = 3
_SHOWN = 4
_NAMED = 6
"""An effect of more parameters is a shape, of which no single one says anything."""


def explanation(established: Established, diagnosis: Findings) -> str:
    """A paragraph: what it is, the evidence, the parameters, cause and cure, the expected error."""
    effect = established.found.candidate.effect
    campaign = diagnosis.result.problem.campaign
    parts = [headline(effect) + "."]
    parts.append(_evidence(established, diagnosis, campaign))
    parts += _fitted(established.estimates)
    parts += _as_built(established, diagnosis)
    doubtful = [e for e in established.estimates if not e.plausible]
    parts += [
        f"{e.name} lies outside what a sound machine shows "
        f"({amount(e.range[0], e.unit)} … {amount(e.range[1], e.unit)}): look for a wrong unit "
        "or another cause."
        for e in doubtful
    ]
    if established.aliases:
        names = "; ".join(a.found.candidate.effect.spec for a in established.aliases[:4])
        parts.append(f"This campaign cannot tell it from: {names}.")
    if cause := section(effect, "Typical causes"):
        parts.append(f"Typical causes: {_sentence(cause)}")
    if cure := section(effect, "Cure"):
        parts.append(f"Cure: {_sentence(cure)}")
    if effect.scope == "instrument":
        parts.append("It belongs to the instrument and never goes into the compensation.")
    unit, _, factor = diagnosis.unit
    before, after = diagnosis.rms * factor, established.rms_after * factor
    parts.append(f"Added, it brings the residuals from {before:.2f} to {after:.2f} {unit} RMS.")
    return " ".join(parts)


def _fitted(estimates: Sequence[Estimate]) -> list[str]:
    """What the campaign says of the parameters; of which of them it says nothing."""
    said = [e for e in estimates if e.measured]
    silent = [e.name for e in estimates if not e.measured]
    parts = []
    if shown := ", ".join(parameter(e) for e in said[:_SHOWN]):
        more = len(said) - _SHOWN
        parts.append(f"Fitted: {shown}{f' and {more} more' if more > 0 else ''}.")
    if said and silent:
        names = ", ".join(silent[:_SHOWN])
        more = len(silent) - _SHOWN
        parts.append(
            f"This campaign says nothing of {names}{f' and {more} more' if more > 0 else ''}."
        )
    return parts


def _as_built(established: Established, diagnosis: Findings) -> list[str]:
    """What is physically there: of a rotary axis's line, of a table itself."""
    effect, model = established.found.candidate.effect, diagnosis.result.problem.model
    values = {e.name: Value(e.value, e.sd, e.measured) for e in established.estimates}
    if isinstance(effect, RotaryLocation):
        kept = tuple(t for t in model.terms if t.effect != effect)
        line = average_lines(Model(model.machine, (*kept, Term(effect, values))))
        return [_sentence(w) for one in line if one.axis == effect.axis for w in one.words()]
    if seen_factor(model.machine, effect) > 0.0:
        return []
    return ["On the table itself (level, indicator, R-test) it has the opposite sign."]


def _evidence(established: Established, diagnosis: Findings, campaign: Campaign) -> str:
    found = established.found
    unit, _, factor = diagnosis.unit
    shown = campaign.kind == (Kind.ROTATION if diagnosis.of_rotations else Kind.DISPLACEMENT)
    signature = established.signature
    largest = float(np.abs(signature[shown]).max()) * factor if shown.any() else 0.0
    text = (
        f"Of the {diagnosis.tests} candidates tested it explains the residuals best: χ² falls by "
        f"{found.evidence.f_drop:.0f} for {_columns(found.screened.rank)}"
        f" ({_chance(found.evidence.log_p)})"
    )
    text += f", up to {largest:.1f} {unit}" if largest > 0.0 else ""
    if places := _where(signature, campaign, diagnosis):
        text += f", most of it in {places}"
    gain = established.cross_validated_gain
    if gain > 0.0:
        return text + f"; blocks left out of the fit are predicted with {gain:.0%} less variance."
    return text + "; blocks left out of the fit are not predicted better."


def _columns(rank: int) -> str:
    return "one coefficient" if rank == 1 else f"{rank} coefficients"


def _chance(log_p: float) -> str:
    power = log_p / np.log(10.0)
    return "chance: none" if power < -99 else f"chance: 1 in 10^{-power:.0f}"


def _where(signature: F64, campaign: Campaign, diagnosis: Findings) -> str:
    setup = campaign.conditions.setup
    if setup is None:
        return ""
    weighted = (signature * diagnosis.result.problem.weight) ** 2
    names, inverse = np.unique(setup, return_inverse=True)
    share = np.bincount(inverse.reshape(-1), weights=weighted)
    order = np.argsort(-share)[:_MOST_SETUPS]
    return ", ".join(str(names[i]) for i in order if share[i] > 0.0)


def headline(effect: Effect) -> str:
    """The first sentence of an effect's page, with the place."""
    first = inspect.cleandoc(type(effect).__doc__ or effect.kind).split("\n\n")[0]
    first = re.sub(r"\s+", " ", first).rstrip(".")
    where = ", ".join(
        f"{key} {', '.join(map(str, value)) if isinstance(value, list) else value}"
        for key, value in effect.where().items()
    )
    return f"{first} ({where})" if where else first


def section(effect: Effect, name: str) -> str:
    """One section of an effect's page as running text; empty where it has none."""
    lines = inspect.cleandoc(type(effect).__doc__ or "").splitlines()
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


def amount(value: float, unit: str) -> str:
    """A number in the unit that people read: µm, µrad, ppm/K."""
    name, factor = display(unit)
    return f"{in_digits(value * factor)} {name}"


def parameter(estimate: Estimate) -> str:
    """A parameter with its standard deviation, in the unit that people read."""
    name, factor = display(estimate.unit)
    value = with_uncertainty(estimate.value * factor, estimate.sd * factor)
    return f"{estimate.name} = {value} {name}".rstrip()


def description(structure: ResidualPattern) -> str:
    """A pattern in words: how the residuals go, and on which error motion."""
    pattern = structure.pattern
    error_motion = str(pattern.error_motion)
    what = {"d": "the error of the functional point in "}.get(error_motion[0], "")
    place = what + error_motion[1:] if what else f"the tilt {error_motion}"
    text = f"{place}: {pattern.form}"
    if pattern.depends_on == ("t",) and pattern.form.startswith("oscillation"):
        text += ", unrelated to any recorded signal"
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
        yield f"SUSPICIOUS: {suspicion}"
    since = f" since {standing.since}" if standing.since else ""
    for change in standing.changes:
        unit, factor = ("µrad", 1e6) if change.of_rotations else ("µm", 1e3)
        text = f"{change.effect.spec} changed{since}: "
        moved = _moved_parameters(change) if len(change.parameters) <= _NAMED else ""
        text += f"{moved}, " if moved else ""
        text += f"up to {in_digits(change.largest * factor)} {unit} in this campaign"
        if change.aliases:
            text += f"; this campaign cannot tell it from a change of {'; '.join(change.aliases)}"
        yield text
    if standing.changes and standing.else_holds:
        yield "everything else of the model holds"
    elif standing.changes:
        yield "and more than these has changed: fit the whole model again"


def _moved_parameters(change: Change) -> str:
    """The parameters that moved by more than their uncertainty, the surest first."""
    sure = [p for p in change.parameters if abs(p.by) > p.sd]
    sure.sort(key=lambda p: -abs(p.by) / max(p.sd, 1e-300))
    moved = []
    for p in sure[:_MOST_CHANGED]:
        unit, factor = display(p.unit)
        by = with_uncertainty(p.by * factor, p.sd * factor)
        moved.append(
            f"{p.name} by {'' if p.by < 0.0 else '+'}{by} {unit} "
            f"(from {in_digits(p.before * factor, 4)} to {in_digits(p.after * factor, 4)})"
        )
    return ", ".join(moved)
