"""``abbe remove``: one effect less; refitted where campaigns are given."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.lists import ListOptions
from abbe.daemon.arguments.options import (
    AsJson,
    Force,
    HoldoutFiles,
    ModelFile,
    NextModel,
    VersionsReport,
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("remove", cls=ListOptions)(remove)


def remove(
    model: ModelFile,
    effect: Annotated[list[str], typer.Argument(help="The effect, as 'abbe history' names it.")],
    out: NextModel,
    campaign: Annotated[
        list[Path] | None, typer.Option("--campaign", help="Campaigns to refit what is left.")
    ] = None,
    holdout: HoldoutFiles = None,
    as_json: AsJson = False,
    report: VersionsReport = None,
    force: Force = False,
) -> None:
    """Take an effect out of a model; the others keep their values unless campaigns are given."""
    from abbe.compcore.files.model_file import load_model, save_model
    from abbe.compcore.model.revise import without_effect
    from abbe.daemon.answers.model.revise import unfitted
    from abbe.daemon.answers.typed import fitting
    from abbe.daemon.commands.model.next_version import NextVersion

    name = " ".join(effect)
    version = NextVersion(model, campaign or [], holdout or [], out, report)
    say = version.checked(force=force, as_json=as_json)
    if campaign:
        revision, removed = version.refitted(lambda m: without_effect(m, name), adds=False)
        if not as_json:
            say(f"removed: {removed.spec}")
        version.answer(say, revision, None, as_json=as_json)
        return
    loaded = load_model(model)
    less, removed = without_effect(loaded, name)
    kept = unfitted(loaded, less, removed=removed.spec)
    save_model(kept, out)
    version.write_page(kept)
    if as_json:
        say(json.dumps({"removed": removed.spec, "refitted": False}))
        return
    say(f"removed: {removed.spec}; the other effects keep their values")
    say(f"refit them, or give --campaign: {fitting(out)}")
    say(version.written)
