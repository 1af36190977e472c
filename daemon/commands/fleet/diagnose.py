"""``abbe fleet diagnose``: every campaign of many machines diagnosed anew, spread over workers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson
from abbe.daemon.arguments.spread.options import (
    Keep,
    Scheduler,
    TlsAuthority,
    TlsCertificate,
    TlsKey,
    Workers,
)


def register(fleet: typer.Typer) -> None:
    """Add the command to its group."""
    fleet.command("diagnose")(diagnose)


def diagnose(
    place: Annotated[
        Path,
        typer.Argument(
            help="A folder with a folder for each machine (a model, its campaigns), or a CSV "
            "machine,model,campaign.",
            metavar="FOLDER|MANIFEST.csv",
        ),
    ],
    workers: Workers = None,
    scheduler: Scheduler = None,
    tls_ca: TlsAuthority = None,
    tls_cert: TlsCertificate = None,
    tls_key: TlsKey = None,
    keep: Keep = None,
    as_json: AsJson = False,
) -> None:
    """Diagnose every campaign of many machines anew, and say which causes machines share.

    An example: abbe fleet diagnose machines/ --scheduler tcp://10.0.0.5:8786
    """
    from abbe.daemon.answers.fleet_diagnosis import answer
    from abbe.daemon.answers.fleet_diagnosis.diagnosed import diagnosis_tasks
    from abbe.daemon.answers.fleet_diagnosis.fleet_files import fleet_campaigns
    from abbe.daemon.arguments.spread.options import spread_place
    from abbe.daemon.spreading.spread import in_order, spread

    campaigns = fleet_campaigns(place)
    to = spread_place(workers, scheduler, (tls_ca, tls_cert, tls_key), keep, len(campaigns))
    tasks = diagnosis_tasks(campaigns)
    bodies = in_order(spread(tasks, to, "diagnosing"), len(tasks))
    found = [json.loads(body) for body in bodies]
    if as_json:
        typer.echo(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.as_text(found):
        typer.echo(line)
