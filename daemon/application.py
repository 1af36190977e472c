"""The application of typer: ``abbe COMMAND``; each command is a file in `abbe.daemon.commands`.

Commands import what they need when they run, and only the command that is asked for joins the
application, so that ``abbe correct`` starts fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperGroup

from abbe.daemon.commands import register, sections
from abbe.daemon.installed import abbe_version

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter

_WIDEST = 110
"""Columns of a help page, where the terminal has so many."""


class CommandsBySubject(TyperGroup):
    """Lists the commands under their subjects, each with its whole first sentence."""

    def format_commands(self, ctx: Context, formatter: HelpFormatter) -> None:
        """Write the lists; as `click.Group.format_commands`."""
        for title, names in sections().items():
            found = [(name, self.get_command(ctx, name)) for name in names]
            rows = [(name, _first_sentence(c.help or "")) for name, c in found if c is not None]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


def _first_sentence(text: str) -> str:
    words = " ".join(text.split("\n\n")[0].split())
    return words.partition(". ")[0].rstrip(".")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"abbe {abbe_version()}")
        raise typer.Exit


def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    pass


def application(word: str = "") -> typer.Typer:
    """The application with the command of a name; of no command's name, with every one."""
    built = typer.Typer(
        name="abbe",
        help="Makes machine tools and CMMs more accurate than their mechanics, and explains them.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        cls=CommandsBySubject,
        context_settings={"max_content_width": _WIDEST},
    )
    built.callback()(_options)
    register(built, word)
    return built


if TYPE_CHECKING:
    app: typer.Typer


def __getattr__(name: str) -> typer.Typer:
    # every command, for those that ask for it by this name: the tests
    if name != "app":
        raise AttributeError(name)
    globals()["app"] = application()
    return globals()["app"]  # type: ignore[no-any-return]
