"""``abbe verify``: a machine judged by lines that were not fitted; or the plan to measure them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.compcore.sentences import said
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.measurements.sure import (
    Expansion,
    ExpansionSd,
    InstrumentName,
    Misalignment,
    ScaleSd,
    StatedMeans,
    TemperatureSd,
)
from abbe.daemon.arguments.measurements.survey_options import (
    AlongAxes,
    GaugeAtHand,
    Instruments,
    KeepOutBoxes,
    PlanOut,
    PlateAtHand,
    TableRadius,
    TimeThere,
    ToolRadius,
    Tools,
)
from abbe.daemon.arguments.options import ActiveModel, AsJson, Force, PageIn, Report

if TYPE_CHECKING:
    from abbe.compcore.planning.plan import SurveyPlan
    from abbe.compcore.planning.targets import SurveyTask
    from abbe.compcore.verification.verify import Verification
    from abbe.daemon.answers.measurements.verified import VerificationAnswer
    from abbe.daemon.answers.measurements.verified_files import (
        FittedCampaigns,
        NamedModel,
        VerifiedFiles,
    )
    from abbe.daemon.outputs import Say


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("verify")(verify)


def verify(
    model: Annotated[
        Path, typer.Argument(help="Model, or configuration that names it.", metavar="MODEL.toml")
    ],
    campaigns: Annotated[
        list[Path] | None, typer.Argument(help="Measured lines.", metavar="CAMPAIGN.csv")
    ] = None,
    before: Annotated[
        list[Path] | None,
        typer.Option(help="The same lines without compensation.", metavar="CAMPAIGN.csv"),
    ] = None,
    active: ActiveModel = None,
    check: Annotated[
        Path | None, typer.Option(help="The check plan that was measured.", metavar="PLAN.toml")
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(help="A=8um, X.R=4um, body.E=15um; may be repeated.", metavar="FIGURE=SIZE"),
    ] = None,
    mpe: Annotated[
        str | None,
        typer.Option(help='Limit of lengths, µm with L in mm: "1.9+L/300".', metavar="A+L/K"),
    ] = None,
    coverage: Annotated[
        float, typer.Option(callback=within(1.0, 4.0, ""), help="k of U = k·u.")
    ] = 2.0,
    instrument: InstrumentName = None,
    scale_sd: ScaleSd = None,
    temperature_sd: TemperatureSd = 0.2,
    expansion: Expansion = 11.5,
    expansion_sd: ExpansionSd = 1.0,
    misalignment: Misalignment = 0.5,
    fitted: Annotated[
        list[Path] | None,
        typer.Option(help="What the model was fitted to, if elsewhere.", metavar="CAMPAIGN.csv"),
    ] = None,
    tables: Annotated[
        Path | None, typer.Option(help="Folder of the tables that were active.", metavar="DIR")
    ] = None,
    out: PlanOut = None,
    instruments: Instruments = None,
    time: TimeThere = "4h",
    runs: Annotated[int, typer.Option(help="Of each planned line, each way.", min=1, max=100)] = 5,
    tool: Tools = None,
    gauge: GaugeAtHand = None,
    plate: PlateAtHand = None,
    keep_out: KeepOutBoxes = None,
    along_axes: AlongAxes = False,
    tool_radius: ToolRadius = 0.0,
    table_radius: TableRadius = 0.0,
    as_json: AsJson = False,
    report: Report = None,
    language: PageIn = "en",
    force: Force = False,
) -> None:
    """Judge a machine by lines that its model was not fitted to, before and after.

    Exit status 0: passes, or nothing is stated; 3: fails; 4: neither is proven (ISO 14253-1).
    With -o and no campaign: the check plan, lines that no fitted campaign measured.

    An example: abbe verify model.toml after.csv --before before.csv --tolerance A=8um
    """
    from abbe.compcore.errors import InputError
    from abbe.daemon.answers.measurements import verify as answer
    from abbe.daemon.answers.measurements.verified_files import (
        VerifiedFiles,
        fitted_campaigns,
        named_model,
    )
    from abbe.daemon.outputs import PLAN, REPORT, check_outputs
    from abbe.daemon.printed_in import printed_in
    from abbe.daemon.report.language import language as known_language

    spoken = known_language(language)
    files = VerifiedFiles(
        tuple(campaigns or []), tuple(before or []), active, check, tables, tuple(fitted or [])
    )
    say = check_outputs(
        [model, gauge, plate, *files.all()],
        [(out, PLAN), (report, REPORT)],
        force=force,
        as_json=as_json,
    )
    if bool(files.campaigns) == (out is not None):
        raise InputError(
            "a check plan is made before anything is measured"
            if files.campaigns
            else "neither what was measured nor where a check plan goes",
            field="-o",
            expected="campaigns to be judged, or -o PLAN.toml without any",
        )
    named = named_model(model)
    known = fitted_campaigns(named, files.fitted)
    if out is not None:
        from abbe.compcore.files.gauge_file import read_gauge
        from abbe.compcore.files.plate_file import read_plate
        from abbe.compcore.planning.envelope import WorkingSpace
        from abbe.compcore.planning.targets import SurveyTask
        from abbe.daemon.arguments.plan_arguments import keep_out_of, seconds_of, tools_of

        space = WorkingSpace(keep_out_of(keep_out or []), tool_radius, table=table_radius)
        task = SurveyTask(
            named.model, space, tools_of(tool or []),
            gauge=None if gauge is None else read_gauge(gauge),
            plate=None if plate is None else read_plate(plate), along_axes=along_axes,
        )  # fmt: skip
        made = _planned(task, known, instruments, seconds_of(time), runs)
        with printed_in(spoken):
            _tell_plan(made, named, known, out, report, say, as_json=as_json)
        return

    means = StatedMeans(instrument, scale_sd, temperature_sd, expansion, expansion_sd, misalignment)
    done = judge(named, known, files, tolerance or [], mpe, report, means=means, coverage=coverage,
                 language=language)  # fmt: skip
    if as_json:
        say(json.dumps(answer.as_json(done), ensure_ascii=False))
    else:
        for line in answer.as_text(done, spoken.say):
            say(line)
        if report is not None:
            say(spoken.say(said("written: {files}", files=report)))
    raise typer.Exit(answer.STATUS[done.verification.outcome])


def judge(
    named: NamedModel,
    known: FittedCampaigns,
    files: VerifiedFiles,
    tolerance: Sequence[str],
    mpe: str | None,
    report: Path | None,
    *,
    means: StatedMeans | None = None,
    coverage: float = 2.0,
    notes: Sequence[str] = (),
    doubt: Callable[[Verification], str] | None = None,
    language: str = "en",
) -> VerificationAnswer:
    """Judge what was measured, as the command does, and write the certificate.

    Parameters
    ----------
    tolerance, mpe
        As they are typed.
    notes
        What else takes weight from it, for the certificate.
    doubt
        Why what was found proves nothing all the same, or empty.
    language
        Of the certificate.

    Raises
    ------
    InputError
        As `verified`, and for what is stated and cannot be read.
    """
    from abbe.compcore.artefacts.permissible import PermissibleError
    from abbe.daemon.answers.measurements.verified import verified
    from abbe.daemon.arguments.measurements.tolerances import tolerances_of

    done = verified(
        named,
        known,
        files,
        tolerances_of(tolerance, named.model.machine),
        None if mpe is None else PermissibleError.parse(mpe),
        means or StatedMeans(),
        coverage,
    )
    done = replace(done, notes=tuple(notes))
    if doubt is not None:
        found = done.verification
        done = replace(done, verification=replace(found, doubt=doubt(found)))
    if report is not None:
        from abbe.daemon.report.language import language as known_language
        from abbe.daemon.report.measurements.certificate import certificate

        certificate(done, known_language(language)).write(report)
    return done


def _planned(
    task: SurveyTask, known: FittedCampaigns, instruments: str | None, seconds: float, runs: int
) -> SurveyPlan:
    """The check plan."""
    from abbe.compcore.planning.check_lines import plan_check
    from abbe.compcore.planning.instruments import instruments_called
    from abbe.daemon.progress import shown

    called = instruments_called([w.strip() for w in (instruments or "laser").split(",")])
    with shown("lines that were not fitted"):
        return plan_check(task, called, seconds, known.campaign, runs=runs)


def _tell_plan(
    made: SurveyPlan, named: NamedModel, known: FittedCampaigns, out: Path,
    report: Path | None, say: Say, *, as_json: bool,
) -> None:  # fmt: skip
    from abbe.compcore.files.plan_file import write_plan
    from abbe.daemon.answers.measurements import survey

    write_plan(made, out, str(named.path), in_one_go=True)
    if report is not None:
        from abbe.daemon.report.measurements.survey import page

        page(made, named.path).write(report)
    if as_json:
        found = {**survey.as_json(made), "not_at_hand": list(known.absent)}
        say(json.dumps(found, ensure_ascii=False))
        return
    for line in survey.as_text(made):
        say(line)
    if known.campaign is None or known.absent:
        names = ", ".join(known.absent) or said("what the model was fitted to")
        say(
            said(
                "  WARNING: not at hand: {files}; its lines may be among these (--fitted)",
                files=names,
            )
        )
    say(said("written: {files}", files=", ".join(str(p) for p in (out, report) if p is not None)))
