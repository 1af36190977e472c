"""``abbe fleet compare``: effects' parameters over the machines of a type."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.fleet import MachineType, Site, StoreUrl, require_store
from abbe.daemon.arguments.options import AsJson, Force


def register(fleet: typer.Typer) -> None:
    """Add the command to the group."""
    fleet.command("compare")(compare)


def compare(
    models: Annotated[
        list[Path] | None,
        typer.Argument(help="Fitted models, one a machine; without: the store's.",
                       metavar="[MODEL.toml]..."),
    ] = None,
    store: StoreUrl = "",
    site: Site = "",
    kind: MachineType = "",
    effect: Annotated[
        str, typer.Option("--effect", help="Only this kind, with each machine's own.")
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", help="The model that is known of the type's next machine.",
            metavar="NEXT.toml",
        ),
    ] = None,
    as_json: AsJson = False,
    force: Force = False,
) -> None:  # fmt: skip
    """What machines of a type have in common: mean and scatter of every fitted parameter.

    With -o a model of the machine that comes next: the type's means, with how machines scatter as
    what is known of them. `abbe diagnose NEXT.toml CAMPAIGN.csv` then says in what a new machine
    differs from all others.

    An example: abbe fleet compare --type "VMC 850" --effect scale_expansion
    """
    from contextlib import nullcontext

    from abbe.compcore.files.model_file import load_model, save_model
    from abbe.compcore.fleet.next_machine import next_machine
    from abbe.compcore.fleet.pooled import pooled
    from abbe.daemon.answers.fleet import pooled as answer
    from abbe.daemon.fleet.asked.machine_folders import MachineFolder, of_store
    from abbe.daemon.outputs import MODEL, check_outputs

    given = [MachineFolder(path.stem, path, ()) for path in models or []]
    say = check_outputs([m.model for m in given], [(out, MODEL)], force=force, as_json=as_json)
    with nullcontext(given) if given else of_store(require_store(store), site, kind) as machines:
        loaded = [load_model(m.model) for m in machines]
        found = pooled(loaded, [m.name for m in machines])
    if out is not None:
        save_model(next_machine(found, loaded[0]), out)
    if as_json:
        say(json.dumps(answer.as_json(found), ensure_ascii=False))
        return
    for line in answer.lines(found, effect):
        say(line)
    if out is not None:
        say(f"written: {out}")
