"""``abbe correct``: where a machine really is at one point, or at a file of points."""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abbe.daemon.arguments.options import AsJson, Force, ModelFile

if TYPE_CHECKING:
    from abbe.compcore.model.model import Model
    from abbe.daemon.answers.correct import Corrected
    from abbe.daemon.answers.correct_file import CorrectedFile
    from abbe.daemon.arguments.point_arguments import Given


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("correct")(correct)


def correct(
    model: ModelFile,
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            help="X=.. Y=.. Z=.. in mm (rotary: degrees), tool=x,y,z, SIGNAL=.., X_dir=1 or -1, "
            "time=.. in s; beside --points for what the file lacks.",
            metavar="[KEY=VALUE]...",
        ),
    ] = None,
    command: Annotated[
        bool,
        typer.Option("--command", help="What a CNC must be commanded to reach the given target."),
    ] = False,
    hold: Annotated[
        str,
        typer.Option(
            help="With --command: rotary axes that are not to be moved, comma-separated, or `all`.",
            metavar="AXES",
        ),
    ] = "",
    explain: Annotated[
        bool, typer.Option("--explain", help="Each effect's part of the correction.")
    ] = False,
    points: Annotated[
        Path | None, typer.Option(help="Many points: columns as in a campaign.", metavar="IN.csv")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="The points with columns X_corrected, …", metavar="CSV"),
    ] = None,
    sure: Annotated[
        bool,
        typer.Option("--uncertainty", help="With --points: the ± of each row, and why it is wide."),
    ] = False,
    as_json: AsJson = False,
    report: Annotated[
        Path | None,
        typer.Option(help="A page with each effect's part at one point.", metavar="FILE.html"),
    ] = None,
    force: Force = False,
) -> None:
    """Correct one point, or a file of points: indicated position → where it really is.

    An example: abbe correct model.toml X=200 Y=600 Z=-150 tool=0,0,-80 T_x=21.3
    """
    from abbe.compcore.files.model_file import load_model
    from abbe.daemon.arguments.point_arguments import Given, held_axes
    from abbe.daemon.outputs import CORRECTED, REPORT, check_outputs

    if (points is None) != (out is None):
        raise typer.BadParameter("--points IN.csv and -o OUT.csv go together")
    if points is not None and (explain or report):
        raise typer.BadParameter("--explain and --report are for one point")
    if sure and points is None:
        raise typer.BadParameter("--uncertainty is for --points; one point always has its ±")
    if hold and not command:
        raise typer.BadParameter("--hold goes with --command")
    say = check_outputs(
        [model, points], [(out, CORRECTED), (report, REPORT)], force=force, as_json=as_json
    )
    whole = load_model(model)
    loaded = whole.switched()
    given = Given.parse(arguments or [], loaded.machine)
    held = held_axes(hold, loaded.machine)
    if points is not None and out is not None:
        done = _many_points(whole, points, out, given, command=command, held=held, sure=sure)
        say(json.dumps(done.as_json(out), ensure_ascii=False) if as_json else done.as_text(out))
        return
    found, warnings = _at_one_point(loaded, given, command=command, held=held)
    switched = _switched(whole, given) if loaded is not whole else {}
    if report is not None:
        from abbe.daemon.report.correct import corrected_page
        from abbe.daemon.report.head import file_on_page, head_of

        head = head_of(loaded, [file_on_page("model", model)])
        corrected_page(found, warnings, loaded.machine.name, head).write(report)
    from abbe.daemon.answers import correct as answer

    if as_json:
        reported = answer.as_json(found, warnings, explain=explain) | switched
        say(json.dumps(reported, ensure_ascii=False))
        return
    for line in answer.as_text(found, explain=explain):
        say(line)
    if report is not None:
        say(f"written: {report}")


def _many_points(
    whole: Model,
    points: Path,
    out: Path,
    given: Given,
    *,
    command: bool,
    held: Collection[str],
    sure: bool,
) -> CorrectedFile:
    """The points of a file, corrected and written."""
    from abbe.daemon.answers.correct_file import correct_file
    from abbe.daemon.answers.switches import not_applied
    from abbe.daemon.progress import shown

    model = whole.switched()
    with shown("correcting") as tell:
        done = correct_file(
            model, points, out, given, command=command, held=held, sure=sure, tell=tell
        )
    if model is not whole:
        done.warnings += not_applied(whole)
    _warn(done.warnings)
    return done


def _switched(whole: Model, given: Given) -> dict[str, Any]:
    """What is not applied, for ``--json``; said on standard error."""
    from abbe.daemon.answers.switches import notes, shown_parts, switches_json

    parts = shown_parts(whole, given.conditions)
    _warn(notes(whole, parts))
    return switches_json(whole, parts)


def _at_one_point(
    model: Model, given: Given, *, command: bool, held: Collection[str]
) -> tuple[Corrected, list[str]]:
    """The correction, and what speaks against believing it."""
    from abbe.compcore.model.uncertainty import in_words
    from abbe.daemon.answers.correct import correct_point
    from abbe.daemon.arguments.point_arguments import doubts

    found = correct_point(model, given.conditions(model), command=command, held=held)
    warnings = [*doubts(model, given), *in_words(found.sure)]
    _warn(warnings)
    return found, warnings


def _warn(warnings: list[str]) -> None:
    for warning in warnings:
        typer.echo(f"abbe: note: {warning}", err=True)
