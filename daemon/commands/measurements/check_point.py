"""``abbe check-point``: is the machine still the one that its model describes?"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import AsJson, Force, Report

if TYPE_CHECKING:
    from abbe.compcore.campaign.campaign import Campaign
    from abbe.daemon.answers.measurements.checked_machine import CheckedMachine


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("check-point")(check_point)


def check_point(
    machine: Annotated[
        Path, typer.Argument(help="Model, or configuration.", metavar="MODEL.toml|CONFIG.toml")
    ],
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            help="A check to record: NAME found=x,y,z (mm), or NAME value=.. u=X (µm), with "
            "SIGNAL=.. tool=x,y,z sd=.. (µm) when=..",
            metavar="[NAME KEY=VALUE...]",
        ),
    ] = None,
    campaign: Annotated[
        Path | None, typer.Option(help="A check to record, measured.", metavar="CAMPAIGN.csv")
    ] = None,
    when: Annotated[
        str, typer.Option(help="With --campaign: of its first row; default by its clock, or now.")
    ] = "",
    lasting: Annotated[
        bool,
        typer.Option("--lasting", help="With --campaign: artefacts stay where they are for good."),
    ] = False,
    active: Annotated[
        Path | None,
        typer.Option(help="The model that corrected while the check was read.", metavar="MODEL"),
    ] = None,
    checks: Annotated[
        Path | None,
        typer.Option(help="Where checks are kept; default checks.csv beside.", metavar="CSV"),
    ] = None,
    since: Annotated[
        str, typer.Option(help="Checks from here on count; default: since the machine was fitted.")
    ] = "",
    changed: Annotated[
        Path | None,
        typer.Option(help="Write what was read since a change, for abbe diagnose.", metavar="CSV"),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            "--false-alarm-every",
            callback=within(10.0, 1e6, "checks"),
            help="Checks in which a sound machine may be accused once; default 5000.",
        ),
    ] = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Record a check measurement, and say whether the machine has changed since it was measured.

    Without a reading only the charts are shown. An example:
    abbe check-point model.toml sphere1 found=80.0012,99.9987,-300.0004 T_x=20.3
    """
    from abbe.compcore.errors import InputError
    from abbe.compcore.files.campaign_file import write_campaign
    from abbe.compcore.files.checks_file import add_checks, read_checks
    from abbe.daemon.answers.measurements import check_point as answer
    from abbe.daemon.answers.measurements.checked_machine import CheckedMachine
    from abbe.daemon.outputs import CAMPAIGN, REPORT, check_outputs

    if campaign is not None and arguments:
        raise InputError("a check is typed, or read from --campaign", found=" ".join(arguments))
    for given, name in ((when, "--when"), (lasting, "--lasting")):
        if given and campaign is None:
            raise InputError(f"{name} goes with --campaign", field=name)
    if active is not None and campaign is None and not arguments:
        raise InputError("--active goes with a reading", field="--active")
    checked = CheckedMachine.of(machine, checks, since, every)
    say = check_outputs(
        [machine, checked.model_path, checked.checks, campaign, active],
        [(changed, CAMPAIGN), (report, REPORT)],
        force=force,
        as_json=as_json,
    )
    new = _new(checked, arguments or [], campaign, when, active, lasting=lasting)
    if new is None:
        known = read_checks(checked.checks, checked.model.machine)
    else:
        known = add_checks(checked.checks, new, checked.model.machine)
    found = checked.judged(known)
    if changed is not None:
        write_campaign(found.judgement.changed_rows(), changed)
    if report is not None:
        from abbe.daemon.report.measurements.check_point import page

        page(found, checked.model, checked.model_path).write(report)
    if as_json:
        say(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.as_text(found):
        say(line)
    if written := [str(path) for path in (changed, report) if path is not None]:
        say(f"written: {', '.join(written)}")


def _new(
    checked: CheckedMachine,
    arguments: list[str],
    campaign: Path | None,
    when: str,
    active: Path | None,
    *,
    lasting: bool,
) -> Campaign | None:
    """The rows of the check that is to be recorded."""
    from abbe.compcore.files.campaign_file import read_campaign, require_signals
    from abbe.compcore.files.model_file import load_model
    from abbe.compcore.fitting.design.superposition import uncompensated
    from abbe.compcore.monitoring.readings import check_readings
    from abbe.daemon.answers.measurements.check_point import placed
    from abbe.daemon.answers.measurements.check_rows import check_rows
    from abbe.daemon.arguments.measurements.check_reading import TypedReading
    from abbe.daemon.arguments.moments import moment

    model, now = checked.model, time.time()
    correcting = None if active is None else load_model(active)
    if campaign is not None:
        read = read_campaign(campaign, model.machine)
        require_signals(read, model)
        moved = moment(when, "--when") if when else None
        new = placed(read, moved, now, lasting=lasting)
    elif arguments:
        typed = TypedReading.parse(arguments, model.machine)
        before, known = checked.recorded(), checked.signals(now)
        return check_rows(typed, model, now, before, known, correcting)
    else:
        return None
    if correcting is not None:
        corrected = correcting.switched()
        require_signals(new, corrected)
        new = uncompensated(new, corrected)
    # what cannot be judged is not recorded either
    check_readings(model, new)
    return new
