"""``abbe switch``: single compensations of a running correction on, off, or only shown."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, ConfigFile


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("switch")(switch)


def switch(
    config: ConfigFile,
    effect: Annotated[
        str | None, typer.Argument(help="The effect, as `abbe history` names it.")
    ] = None,
    to: Annotated[str | None, typer.Argument(help="on, off or shown.")] = None,
    table: Annotated[
        str, typer.Option(help="One table of an effect that has several.", metavar="NAME")
    ] = "",
    as_json: AsJson = False,
) -> None:
    """Switch one compensation of the correction that runs; without an effect, show all.

    An example: abbe switch config.toml "scale_expansion axis=X" off
    """
    from abbe.daemon.arguments.live.running import asked, switch_of
    from abbe.daemon.control.requests import StateRequest, SwitchRequest

    if effect is None:
        answer = asked(config, StateRequest())
    elif to is None:
        raise typer.BadParameter("an effect is switched on, off or shown")
    else:
        answer = asked(config, SwitchRequest(effect=effect, to=switch_of(to), table=table))
    if as_json:
        typer.echo(json.dumps(answer, ensure_ascii=False))
        return
    if effect is not None:
        typer.echo(answer["said"] or "nothing to change")
    else:
        for name, state in answer["switches"].items():
            there = answer["in_file"].get(name)
            typer.echo(f"{state:<6} {name}" + (f"  (model file: {there})" if there else ""))
    if answer["until"]:
        typer.echo(answer["until"])
