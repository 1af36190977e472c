"""``abbe token``: who may look at a run over HTTP, and who may change it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within

_CONFIG = typer.Argument(help="Configuration file with [http].", metavar="CONFIG.toml")


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    token = typer.Typer(
        help="Tokens for a run's HTTP interface ([http] in the configuration).",
        no_args_is_help=True,
    )
    token.command("add")(add)
    token.command("list")(show)
    token.command("remove")(remove)
    app.add_typer(token, name="token")


def add(
    config: Annotated[Path, _CONFIG],
    name: Annotated[str, typer.Argument(help="Who will use it, for the journal.", metavar="NAME")],
    role: Annotated[
        str, typer.Option(help="view: look; operate: also change what runs.", metavar="ROLE")
    ] = "view",
    days: Annotated[
        float | None,
        typer.Option(callback=within(0.01, 36500.0, "days"), help="Days for which it counts."),
    ] = None,
) -> None:
    """Make a token. It is printed now and never again: only its SHA-256 is kept.

    An example: abbe token add config.toml prometheus
    """
    from abbe.daemon.arguments.live.tokens import role_of, token_file
    from abbe.daemon.config.tokens import add_token

    typer.echo(add_token(token_file(config), name, role_of(role), days))


def show(config: Annotated[Path, _CONFIG]) -> None:
    """All tokens by name: role, when they were made, until when they count."""
    from abbe.daemon.arguments.live.tokens import token_file
    from abbe.daemon.config.tokens import read_tokens

    for name, token in read_tokens(token_file(config)).items():
        until = "" if token.expires is None else f", until {token.expires:%Y-%m-%d %H:%M}"
        over = ", EXPIRED" if token.expired else ""
        typer.echo(f"{name}: {token.role}, made {token.created:%Y-%m-%d %H:%M}{until}{over}")


def remove(
    config: Annotated[Path, _CONFIG],
    name: Annotated[str, typer.Argument(help="As the list has it.", metavar="NAME")],
) -> None:
    """Have a token count no more, at once, also in a run."""
    from abbe.daemon.arguments.live.tokens import token_file
    from abbe.daemon.config.tokens import remove_token

    remove_token(token_file(config), name)
    typer.echo(f"removed: {name}")
