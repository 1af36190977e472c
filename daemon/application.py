"""The application of typer: ``abbe COMMAND``; each command is a file in `abbe.daemon.commands`.

Commands import what they need when they run, so that ``abbe correct`` starts fast.
"""

from __future__ import annotations

from importlib.metadata import version as installed_version
from typing import Annotated

import typer

from abbe.daemon.commands import register

app = typer.Typer(
    name="abbe",
    help="Makes machine tools and CMMs more accurate than their mechanics, and explains them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"abbe {installed_version('abbe')}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    pass


register(app)
