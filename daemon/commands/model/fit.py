"""``abbe fit``: all effects of a model from any mixture of measurements."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.compcore.sentences import said
from abbe.daemon.arguments.options import (
    ActiveModel,
    AsJson,
    CampaignFiles,
    Force,
    ModelFile,
    Renew,
    Report,
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("fit")(fit)


def fit(
    model: ModelFile,
    campaigns: CampaignFiles,
    out: Annotated[Path, typer.Option("-o", "--out", help="The fitted model.")],
    robust: Annotated[
        bool, typer.Option("--robust", help="Set outliers aside; they are listed.")
    ] = False,
    cautious: Annotated[
        bool,
        typer.Option(
            "--cautious",
            help="What the campaign shows little of stays near 0, in place of being extrapolated.",
        ),
    ] = False,
    renew: Renew = False,
    frame: Annotated[
        str,
        typer.Option(help="Reference frame: least-squares, or primary and secondary axis: X,Y."),
    ] = "least-squares",
    frame_tool: Annotated[
        str | None,
        typer.Option(
            help="Tool offset (mm) for which the frame holds: x,y,z; the campaign's if not given."
        ),
    ] = None,
    active: ActiveModel = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Fit all parameters of a model to campaigns and write the fitted model."""
    from abbe.compcore.diagnosis.renewing import forgotten
    from abbe.compcore.diagnosis.renewing import renew as known_before
    from abbe.compcore.errors import FitError, InputError
    from abbe.compcore.files.model_file import save_model
    from abbe.compcore.files.model_toml.fit_record import recorded
    from abbe.compcore.fitting.cautious import cautiously
    from abbe.compcore.fitting.fit import fit as fit_model
    from abbe.compcore.fitting.frame import ReferenceFrame
    from abbe.daemon.answers.inputs import load, now
    from abbe.daemon.answers.model import expected_times as expected
    from abbe.daemon.answers.model import fit as answer
    from abbe.daemon.arguments.assignments import tool_offset
    from abbe.daemon.installed import abbe_version
    from abbe.daemon.outputs import MODEL, REPORT, check_outputs
    from abbe.daemon.progress import shown

    chosen = ReferenceFrame.parse(
        frame, None if frame_tool is None else tool_offset("frame-tool", frame_tool)
    )
    if renew and (cautious or chosen.primary):
        raise InputError(
            "--renew keeps the values and the frame of the model as it was",
            field="--renew",
            found="--cautious" if cautious else "--frame",
            expected="one of the two",
        )
    say = check_outputs(
        [model, *campaigns, active], [(out, MODEL), (report, REPORT)], force=force, as_json=as_json
    )
    with shown("reading", expected.fitting(campaigns)) as tell:
        loaded, campaign = load(model, campaigns, active)
        if loaded.effects and all(effect.given for effect in loaded.effects):
            raise FitError(
                "there is nothing to fit: all values of this model are given; add what may be left "
                "('abbe add', 'abbe diagnose'), or lay it beside the measurements ('abbe compare')"
            )
        result = fit_model(loaded, campaign, robust=robust, frame=chosen, progress=tell)
        if cautious:
            result = cautiously(result)
        if renew:
            tell("what was known before")
            result = known_before(loaded, result, result)
        tell("noise floor")
        lengths = result.noise.lengths
        record = recorded(
            result,
            loaded,
            date=now(),
            version=abbe_version(),
            noise_floor=None if lengths is None else lengths.value,
            noise_floor_rotation=result.noise.value("rotation"),
        )
        tell("outliers, and whether bodies are rigid")
        # all that could fail comes before anything is written
        if as_json:
            reported = json.dumps(answer.as_json(result, result.noise), ensure_ascii=False)
        else:
            reported = result.report()
        page = None
        if report is not None:
            from abbe.daemon.report.head import file_on_page, head_of
            from abbe.daemon.report.model.fit import fit_page

            tell("drawing")
            head = head_of(loaded, [file_on_page("model, as it was", model)], campaign)
            page = fit_page(result, record, result.noise, head)
        save_model(record, out)
        if page is not None and report is not None:
            page.write(report)
    say(reported)
    if as_json:
        return
    if not renew and (lost := forgotten(loaded, result)) is not None:
        say(lost)
    say(said("written: {files}", files=str(out) if report is None else f"{out}, {report}"))
