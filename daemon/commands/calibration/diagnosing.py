"""Completing a model in a calibration: what is missing is named, and added where one agrees."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from abbe.compcore.campaign.even_steps import even_steps
from abbe.compcore.campaign.noise import noise_floor
from abbe.compcore.campaign.sampling import resolves
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.explain import doubts_of, gain_of
from abbe.compcore.diagnosis.words import diagnosis_words
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits
from abbe.daemon.answers.inputs import load
from abbe.daemon.answers.model import expected_times as expected
from abbe.daemon.answers.model.revise import as_text
from abbe.daemon.answers.typed import Adding
from abbe.daemon.arguments.assignments import split_assignments
from abbe.daemon.calibration.asking import AskPerson
from abbe.daemon.commands.model.fit import fit
from abbe.daemon.commands.model.next_version import NextVersion
from abbe.daemon.progress import shown
from abbe.daemon.report.model.diagnosis import said_in_the_shop

_MOST = 4
"""Causes that are added, one after the other."""
_SURE = 2.0
"""Standard uncertainties by which a cause's greatest value has to differ from 0."""


def complete_model(
    fitted: Path,
    campaign: Path,
    out: Path,
    say: Callable[[str], None],
    ask: AskPerson,
) -> str:
    """Diagnose a fitted model, add the causes that are established and agreed to, write the last.

    Parameters
    ----------
    say
        Tells a line.
    ask
        Whether a cause may be added; one whose values no sound machine shows not by default.

    Returns
    -------
    Which causes of the latter kind are left out, and why, for people; empty where none is.
    """
    model, doubted = fitted, dict[str, str]()
    for number in range(1, _MOST + 1):
        with shown("reading", expected.diagnosing([campaign], advised=False)) as tell:
            loaded, measured = load(model, [campaign])
            noise = noise_floor(measured, loaded.machine)
            found = diagnose(loaded, measured, progress=tell)
        adding = Adding(model, [campaign], robust=bool(found.strays))
        for line in diagnosis_words(found, noise, (), adding.command, adding.fitting):
            say(line)
        following = out.with_name(f"{fitted.stem}-{number + 1}{fitted.suffix}")
        for cause in found.established:
            spec = cause.effect.spec
            doubts = doubts_of(cause.estimates)
            if doubts and spec in doubted:
                continue
            if doubts:
                doubted[spec] = doubts[0].removesuffix(".")
                asked = said(
                    "{what}. {doubt} Add {spec} all the same?",
                    what=said_in_the_shop(found, cause), doubt=doubts[0], spec=spec,
                )  # fmt: skip
                if not ask(asked, default=False):
                    say(said("{spec} is not added: {why}", spec=spec, why=doubted[spec]))
                    continue
                del doubted[spec]
            elif not ask(
                said(
                    "{what}. {gain} Add {spec}?",
                    what=said_in_the_shop(found, cause),
                    gain=gain_of(cause, found),
                    spec=spec,
                )
            ):
                continue
            lines = add(model, spec, campaign, following, robust=bool(found.strays))
            added = load_model(following)
            hidden = _hidden_wave(added, spec, measured.conditions) or _unsure(added, spec)
            if not hidden:
                for line in lines:
                    say(line)
                break
            following.unlink()
            say(said("{spec} is not added: {why}", spec=spec, why=hidden))
        else:
            if found.strays:
                model = _without_strays(model, campaign, out)
                say(said("fitted once more without what stands alone"))
            break
        model = following
    write_atomically(out, model.read_bytes())
    say(said("written: {file}, which is {model}", file=out, model=model.name))
    return "; ".join(f"established, and left out: {spec}; {why}" for spec, why in doubted.items())


def add(model: Path, spec: str, campaign: Path, out: Path, *, robust: bool) -> list[str]:
    """Write a model with one effect more, fitted; the lines of ``abbe add``, not said yet."""
    version = NextVersion(model, [campaign], [], out, None, robust)
    version.checked(force=False, as_json=False)
    revision, effect = version.refitted(lambda old: with_effect(old, *_named(spec)), adds=True)
    return [*as_text(revision, effect), version.written]


def _named(spec: str) -> tuple[str, dict[str, str]]:
    name, *keys = spec.split()
    return name, split_assignments(keys)


def _without_strays(model: Path, campaign: Path, out: Path) -> Path:
    """A model to which nothing is added, fitted without the readings that stand alone."""
    robust = out.with_name(f"{model.stem}-robust{model.suffix}")
    fit(model, [campaign], out=robust, robust=True, cautious=True)
    return robust


def _unsure(model: Model, spec: str) -> str:
    """Why an effect is not known well enough to correct by; or empty.

    It may be established that something of the kind is there, and its values be anything all the
    same: where others of the model can do nearly the same.
    """
    for term in (t for t in model.terms if t.effect.spec == spec):
        linear = {p.name for p in term.effect.linear(model.machine)}
        known = [v for name, v in term.values.items() if name in linear and v.sd]
        if known and all(abs(v.value) < _SURE * (v.sd or 0.0) for v in known):
            return said(
                "none of its values is more than {times} times its own uncertainty: what it would "
                "correct is not known; measure what tells it from the rest",
                times=f"{_SURE:g}",
            )
    return ""


def _hidden_wave(model: Model, spec: str, conditions: Conditions) -> str:
    """The wave of an effect that a campaign's even steps cannot tell from a longer one; or empty.

    Between the targets such a wave would be corrected that nobody has seen.
    """
    steps = even_steps(conditions)
    for term in (t for t in model.terms if t.effect.spec == spec):
        nonlinear = term.nonlinear(model.machine)
        for axis, wave in term.effect.repeats(model.machine, nonlinear).items():
            if axis in steps and not is_rotary(axis) and not resolves(steps[axis], wave):
                return said(
                    "{axis} was read every {step} mm, which does not tell its wave of {wave} mm "
                    "from a longer one; a line with other steps would",
                    axis=axis, step=in_digits(steps[axis]), wave=in_digits(wave),
                )  # fmt: skip
    return ""
