"""``abbe diagnose``: which physical effect a model lacks, or that it lacks none."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Annotated

import typer

from abbe.compcore.sentences import said
from abbe.daemon.arguments.lists import ListOptions
from abbe.daemon.arguments.options import AsJson, CampaignFiles, Force, HoldoutFiles, ModelFile


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("diagnose", cls=ListOptions)(diagnose)


def diagnose(
    model: ModelFile,
    campaigns: CampaignFiles,
    as_json: AsJson = False,
    report: Annotated[
        Path | None,
        typer.Option("--report", help="A page that tells the story.", metavar="FILE.html"),
    ] = None,
    apply: Annotated[
        bool,
        typer.Option("--apply", help="Add what is missing, step by step, until the verdict."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="The model that --apply leads to.", metavar="NEXT.toml"),
    ] = None,
    holdout: HoldoutFiles = None,
    measure_next: Annotated[
        bool,
        typer.Option(
            "--measure-next/--no-measure-next",
            help="Work out which measurement would tell most; large campaigns are faster without.",
        ),
    ] = True,
    force: Force = False,
) -> None:
    """Learn what is missing: every effect of the catalogue is tested against what is left over.

    The model may be a machine without any effect. With --apply, one command leads from there to a
    fitted model: each cause that is established is added, fitted with all others and kept if blocks
    of the campaign that are left out of the fit are predicted better.
    """
    from abbe.compcore.campaign.noise import noise_floor
    from abbe.compcore.diagnosis import diagnose as diagnose_model
    from abbe.compcore.diagnosis.renewing import renews
    from abbe.compcore.diagnosis.words import diagnosis_words
    from abbe.compcore.errors import InputError
    from abbe.daemon.answers.inputs import load
    from abbe.daemon.answers.model import applied_words
    from abbe.daemon.answers.model import apply as applied
    from abbe.daemon.answers.model import diagnose as diagnosed
    from abbe.daemon.answers.model import expected_times as expected
    from abbe.daemon.answers.model.held_out import read_held_out
    from abbe.daemon.answers.typed import Adding, diagnosing, next_version
    from abbe.daemon.outputs import MODEL, REPORT, check_outputs
    from abbe.daemon.progress import shown

    if apply != (out is not None):
        raise InputError(
            "--apply writes a model, and -o says where",
            field="--apply" if out is not None else "-o",
            expected=f"{diagnosing(model, campaigns)} --apply -o "
            + shlex.quote(str(out or next_version(model))),
        )
    if holdout and not apply:
        raise InputError("--holdout belongs to --apply", field="--holdout")
    say = check_outputs(
        [model, *campaigns, *(holdout or [])],
        [(out, MODEL), (report, REPORT)],
        force=force,
        as_json=as_json,
    )
    reached: applied.ReachedModel | None = None
    with shown("reading", expected.diagnosing(campaigns, advised=measure_next)) as tell:
        loaded, campaign = load(model, campaigns)
        noise = noise_floor(campaign, loaded.machine)
        if out is None:
            found = diagnose_model(loaded, campaign, progress=tell)
        else:
            held = read_held_out(holdout or [], loaded.machine, campaign)
            step_by_step = _silent if as_json else say
            for note in () if held is None else held.notes():
                step_by_step(note)
            reached = applied.reach(
                loaded, campaign, noise, held, out, say=step_by_step, progress=tell
            )
            found = reached.course.diagnosis
        if measure_next:
            tell("what to measure next")
        advice = found.advice if measure_next else ()
    adding = Adding(
        model if out is None else out,
        campaigns,
        robust=bool(found.strays),
        holdout=holdout or (),
        renew=out is None and renews(found),
    )
    if report is not None:
        from abbe.daemon.report.head import file_on_page, head_of
        from abbe.daemon.report.model.diagnosis import page

        head = head_of(loaded, [file_on_page("model", model)], campaign)
        steps = () if reached is None else reached.steps
        page(found, noise, advice, head, adding, steps).write(report)
    if as_json:
        from abbe.compcore.comparison.compare import compare

        answer = diagnosed.as_json(found, noise, advice, compare(loaded, campaign))
        if reached is not None:
            answer |= reached.as_json()
        say(json.dumps(answer, ensure_ascii=False))
        return
    if reached is not None:
        for line in applied_words.as_text(reached.course, reached.model):
            say(line)
        if reached.again is not None:
            for line in reached.again.words():
                say(line)
        say("")
    for line in diagnosis_words(found, noise, advice, adding.command, adding.fitting):
        say(line)
    if reached is not None and (refused := applied_words.still_refused(reached.course)):
        say("")
        say(refused)
    if written := [str(path) for path in (out, report) if path is not None]:
        say(said("written: {files}", files=", ".join(written)))


def _silent(_: str) -> None:
    """Say nothing: the answer is one JSON object."""
