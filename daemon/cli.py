"""The command line: ``abbe COMMAND``; each command is a file in `daemon.commands`.

Commands import what they need when they run, so that ``abbe correct`` starts fast. Exit status:
0 done; 1 could not be done (one message on standard error); 2 wrong usage.
"""

from __future__ import annotations

import contextlib
import sys
from importlib.metadata import version as installed_version
from typing import Annotated

import typer

from daemon.commands import register

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


def main() -> None:
    """Run the command line; a user's mistake is one message, never a traceback."""
    from compcore.errors import AbbeError
    from daemon.show.writer import silence_closed
    from drivers.link import LinkError

    try:
        app()
    except (AbbeError, LinkError) as error:
        with contextlib.suppress(OSError):  # its terminal may have been closed
            sys.stderr.write(f"abbe: {error}\n")
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(0)
    finally:
        silence_closed()
