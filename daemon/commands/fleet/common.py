"""``abbe fleet common``: the same cause on several machines of a type."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.fleet import MachineType, Site, StoreUrl, require_store
from abbe.daemon.arguments.options import AsJson


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("common")(common)


def common(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            help="One a machine, with its model and campaigns; without: the store's machines.",
            metavar="[FOLDER]...",
        ),
    ] = None,
    store: StoreUrl = "",
    site: Site = "",
    kind: MachineType = "",
    since: Annotated[
        datetime | None,
        typer.Option("--since", help="When something happened to all: campaigns after it count."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find causes that several machines of a type have, also where each shows them too weakly.

    Every campaign is diagnosed by itself; then each cause of the catalogue is weighed over all
    machines: some have it, alike, and the others have not. Where the campaigns have several dates,
    also since when.

    An example: abbe fleet common --type "VMC 850" --since 2026-09-14
    """
    from contextlib import nullcontext
    from datetime import UTC

    from abbe.compcore.fleet.common_cause import common_causes
    from abbe.daemon.answers.fleet import common as answer
    from abbe.daemon.fleet.asked.machine_folders import of_folder, of_store
    from abbe.daemon.progress import shown

    with (
        nullcontext([of_folder(f) for f in folders])
        if folders
        else of_store(require_store(store), site, kind) as machines,
        shown("reading") as tell,
    ):
        asked = answer.diagnosed_machines(machines, tell)
        tell("laying the machines together")
        moment = None if since is None else since.replace(tzinfo=UTC)
        found = common_causes(asked, moment)
    if as_json:
        typer.echo(json.dumps(answer.as_json(asked, found), ensure_ascii=False))
        return
    for line in answer.lines(asked, found):
        typer.echo(line)
