"""``abbe uncertainty``: how sure a part program's results are, on a machine known so well."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, Force, ModelFile, Report
from abbe.daemon.arguments.spread.options import (
    Keep,
    Scheduler,
    TlsAuthority,
    TlsCertificate,
    TlsKey,
    Workers,
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("uncertainty")(uncertainty)


def uncertainty(
    model: ModelFile,
    part: Annotated[
        Path,
        typer.Argument(help="Part program: TOML, or a CSV of points.", metavar="PART.toml|csv"),
    ],
    draws: Annotated[
        int, typer.Option(help="Virtual measurements.", min=1000, max=10_000_000)
    ] = 10_000,
    seed: Annotated[int, typer.Option(help="The same gives the same draws.", min=0)] = 1,
    instruments: Annotated[
        str,
        typer.Option(
            help="At hand, to say which measurement would lower it; `all`, `none` or as for plan."
        ),
    ] = "laser,straightness,angle,level,ball-bar,step-gauge,ball-plate",
    workers: Workers = None,
    scheduler: Scheduler = None,
    tls_ca: TlsAuthority = None,
    tls_cert: TlsCertificate = None,
    tls_key: TlsKey = None,
    keep: Keep = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Say how sure a part program's results are: a virtual CMM, task by task.

    The model's parameters are drawn from their covariance, with temperatures, probe and part; every
    draw measures the part, and the features are evaluated. ISO/TS 15530-4 in spirit.

    An example: abbe uncertainty model.toml part.toml --report part.html
    """
    from abbe.compcore.planning.instruments import instruments_called
    from abbe.compcore.virtual_cmm.simulation import BLOCK
    from abbe.daemon.answers.uncertainty import answer
    from abbe.daemon.arguments.spread.options import spread_place
    from abbe.daemon.outputs import REPORT, check_outputs

    say = check_outputs([model, part], [(report, REPORT)], force=force, as_json=as_json)
    names = [] if instruments == "none" else [w.strip() for w in instruments.split(",")]
    at_hand = instruments_called(names)
    place = spread_place(workers, scheduler, (tls_ca, tls_cert, tls_key), keep, -(-draws // BLOCK))
    measurement = answer.require_possible(model, part)
    found = answer.evaluate(measurement, (model, part), draws, seed, place, at_hand)
    if report is not None:
        from abbe.daemon.report.measurements.uncertainty import page

        page(found, model, part).write(report)
    if as_json:
        say(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.as_text(found):
        say(line)
    if report is not None:
        say(f"written: {report}")
