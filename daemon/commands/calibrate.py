"""``abbe calibrate``: plan, program, measure, fit, diagnose, table or live, upload, verify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.compcore.errors import AbbeError
from abbe.daemon.arguments.measurements.plan_reading import Feed, Stands
from abbe.daemon.arguments.options import ConfigFile, PageIn


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("calibrate")(calibrate)


def calibrate(
    config: ConfigFile,
    folder: Annotated[
        Path, typer.Option(help="Where plan, campaign, models, tables, certificate go.",
                           metavar="DIR")
    ] = Path("calibration"),
    time: Annotated[str, typer.Option(help="Time to measure in: 4h, 90min.")] = "4h",
    check_time: Annotated[str, typer.Option(help="Time to verify in.")] = "1h",
    tool: Annotated[
        list[str] | None,
        typer.Option(help="Where the optics or the probe sit, mm; may be repeated.",
                     metavar="NAME=x,y,z"),
    ] = None,
    controller: Annotated[
        str, typer.Option(help="Makes programs for it: linuxcnc, fanuc, …", metavar="NAME")
    ] = "",
    tables: Annotated[
        str, typer.Option(help="Makes tables for it; else the configuration of abbe run.",
                          metavar="NAME")
    ] = "",
    feed: Feed = 3000.0,
    stands: Stands = None,
    at: Annotated[
        list[str] | None,
        typer.Option(help="Conditions that the tables are for, as abbe table takes them.",
                     metavar="SIGNAL=VALUE"),
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(help="What the check has to keep, as abbe verify takes it; may be repeated.",
                     metavar="FIGURE=SIZE"),
    ] = None,
    mpe: Annotated[
        str, typer.Option(help="Limit of lengths, likewise.", metavar="A+L/K")
    ] = "",
    language: PageIn | None = None,
    upto: Annotated[
        str, typer.Option(help="Stop after this step; the same command goes on.", metavar="STEP")
    ] = "",
    yes: Annotated[
        bool, typer.Option("--yes", help="Nobody is asked: every cause that is established is "
                           "added but what no sound machine shows, tables are uploaded.")
    ] = False,
) -> None:  # fmt: skip
    """Lead from 'which measurements?' to a verified machine; stopped at any step, it goes on there.

    An example: abbe calibrate cmm.toml --time 4h --tool P=0,0,-150
    """
    from abbe.compcore.artefacts.permissible import PermissibleError
    from abbe.compcore.errors import InputError
    from abbe.compcore.sentences import said
    from abbe.daemon.arguments.measurements.tolerances import tolerances_of
    from abbe.daemon.arguments.plan_arguments import seconds_of
    from abbe.daemon.calibration.request import CalibrationRequest, require_measured_with
    from abbe.daemon.calibration.step import CALIBRATED
    from abbe.daemon.commands.calibration.guide import calibrate as lead
    from abbe.daemon.commands.calibration.guide import left_out_of, outcome_of
    from abbe.daemon.config import load_config
    from abbe.daemon.measure.person import somebody_there
    from abbe.daemon.printed_in import failing_in, printed_in
    from abbe.daemon.report.language import ENGLISH
    from abbe.daemon.report.language import language as known_language

    spoken = known_language(language or ENGLISH)
    if not yes and not somebody_there():
        raise AbbeError("nobody can be asked (no terminal): say --yes")
    # said before anything is measured
    seconds_of(time)
    seconds_of(check_time, "check-time")
    configuration = load_config(config)
    require_measured_with(configuration)
    tolerances_of(tolerance or [], configuration.model.machine)
    if mpe:
        PermissibleError.parse(mpe)
    request = CalibrationRequest(
        configuration, folder, time, check_time, tuple(tool or ()), controller, tables, yes,
        feed=feed, stands=stands, at=tuple(at or ("reference",)),
        tolerances=tuple(tolerance or ()), mpe=mpe, language=language,
    )  # fmt: skip

    if controller and request.touches:
        raise InputError(
            f"a {request.touches} has no program: Abbe moves the machine",
            field="controller",
            found=controller,
            expected="no --controller",
        )

    def ask(question: str, *, default: bool = True) -> bool:
        try:
            return default if yes else typer.confirm(spoken.say(question), default=default)
        except typer.Abort:
            typer.echo("\n" + spoken.say(said("stopped; the same command goes on here")))
            raise typer.Exit(1) from None

    with printed_in(spoken), failing_in(spoken):
        if not lead(request, typer.echo, ask, upto):
            return
        outcome = outcome_of(request)
        typer.echo(said("calibrated: {folder}; {outcome}", folder=folder, outcome=outcome))
        if not request.tables and not request.corrected_live:
            typer.echo(
                said(
                    "no axis X, Y or Z carries a correction: nothing is written for abbe run; "
                    "`abbe correct {model} --command` says where to send the joints",
                    model=request.file(CALIBRATED),
                )
            )
        if left_out := left_out_of(request):
            typer.echo(spoken.say(left_out))
            if yes:
                typer.echo(said("nobody was asked: the same command without --yes asks for it"))
        if not request.checked_by:
            typer.echo(
                said(
                    "not verified: {instruments} shows no lines to judge; `abbe verify` does by a "
                    "gauge ([probing] gauge) or a laser",
                    instruments=request.instruments,
                )
            )
