"""``abbe add``: one more effect, refitted; the error before and after, also on unseen campaigns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.lists import ListOptions
from abbe.daemon.arguments.options import (
    AsJson,
    Force,
    HoldoutFiles,
    ModelFile,
    NextModel,
    Renew,
    VersionsReport,
)

if TYPE_CHECKING:
    from abbe.compcore.effects.base import Effect
    from abbe.compcore.model.model import Model


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("add", cls=ListOptions)(add)


def add(
    model: ModelFile,
    kind: Annotated[str, typer.Argument(help="Kind of effect, see 'abbe effects'.")],
    campaign: Annotated[
        list[Path], typer.Option("--campaign", help="Campaigns to fit, one or more.")
    ],
    out: NextModel,
    keys: Annotated[
        list[str] | None, typer.Argument(help="KEY=VALUE as 'abbe diagnose' prints them.")
    ] = None,
    holdout: HoldoutFiles = None,
    robust: Annotated[
        bool, typer.Option("--robust", help="Set readings aside that stand alone.")
    ] = False,
    renew: Renew = False,
    as_json: AsJson = False,
    report: VersionsReport = None,
    force: Force = False,
) -> None:
    """Add an effect to a model, refit, and watch the error fall."""
    from abbe.compcore.model.revise import with_effect
    from abbe.daemon.arguments.assignments import split_assignments
    from abbe.daemon.commands.model.next_version import NextVersion

    version = NextVersion(model, campaign, holdout or [], out, report, robust, renew)
    say = version.checked(force=force, as_json=as_json)
    # a whole spec in one pair of quotes is what 'abbe diagnose' prints, too
    name, *more_keys = kind.split() or [kind]

    def with_one_more(loaded: Model) -> tuple[Model, Effect]:
        return with_effect(loaded, name, split_assignments([*more_keys, *(keys or [])]))

    revision, effect = version.refitted(with_one_more, adds=True)
    version.answer(say, revision, effect, as_json=as_json)
