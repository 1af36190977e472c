"""``abbe run``: correct a machine live, until it is ended."""

from __future__ import annotations

from typing import Annotated

import typer

from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import ConfigFile


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("run")(run)


def run(
    config: ConfigFile,
    duration: Annotated[
        float | None,
        typer.Option(callback=within(0.0, 1e9, "s"), help="Seconds to run; default: until Ctrl-C."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object a cycle on standard output.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="Only events, no line every two seconds.")
    ] = False,
) -> None:
    """Correct a machine live: read positions and sensors, write corrected positions back.

    Ctrl-C (or SIGTERM) ramps the correction to zero, tells the controller, and ends; a second one
    ends at once.
    """
    from abbe.daemon.config import load_config
    from abbe.daemon.service import Service, begin_again
    from abbe.daemon.show.attach import choose, run_in_view

    configuration = load_config(config)
    title = f"Abbe · {configuration.model.machine.name or configuration.path.name}"
    made: list[Service] = []

    def service() -> Service:
        made.append(Service(configuration))
        return made[0]

    run_in_view(service, choose(as_json, quiet=quiet), title, duration)
    if made[0].again:
        begin_again()
