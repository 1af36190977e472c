"""``abbe fleet diagnose``: every campaign of many machines diagnosed anew, spread over workers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.groups import grouped
from abbe.daemon.arguments.options import AsJson
from abbe.daemon.arguments.spread.options import SpreadOptions


def register(fleet: typer.Typer) -> None:
    """Add the command to its group."""
    fleet.command("diagnose")(grouped(diagnose))


def diagnose(
    place: Annotated[
        Path,
        typer.Argument(
            help="A folder with a folder for each machine (a model, its campaigns), or a CSV "
            "machine,model,campaign.",
            metavar="FOLDER|MANIFEST.csv",
        ),
    ],
    spreading: SpreadOptions,
    as_json: AsJson = False,
) -> None:
    """Diagnose every campaign of many machines anew, and say which causes machines share.

    An example: abbe fleet diagnose machines/ --scheduler tcp://10.0.0.5:8786
    """
    from abbe.daemon.answers.fleet_diagnosis import answer
    from abbe.daemon.answers.fleet_diagnosis.diagnosed import diagnosis_tasks
    from abbe.daemon.answers.fleet_diagnosis.fleet_files import fleet_campaigns
    from abbe.daemon.spreading.spread import in_order, spread

    campaigns = fleet_campaigns(place)
    tasks = diagnosis_tasks(campaigns)
    to = spreading.place(len(tasks))
    bodies = in_order(spread(tasks, to, "diagnosing"), len(tasks))
    found = [json.loads(body) for body in bodies]
    if as_json:
        typer.echo(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.as_text(found):
        typer.echo(line)
