"""Options that are taken as one argument: as typed, and in the help, like those written singly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from typer.testing import CliRunner

from abbe.daemon.arguments.groups import grouped

Depth = Annotated[float, typer.Option("--depth", help="How deep, mm.", min=0.0)]


@dataclass(frozen=True)
class Hole:
    """A hole."""

    depth: Depth = 1.5
    through: Annotated[bool, typer.Option("--through", help="All the way.")] = False


def drill(
    name: Annotated[str, typer.Argument()], hole: Hole, times: Annotated[int, typer.Option()] = 2
) -> None:
    """Drill a hole."""
    typer.echo(f"{name} {hole.depth} {hole.through} {times}")


def asked(*arguments: str) -> tuple[int, str]:
    app = typer.Typer()
    app.command()(grouped(drill))
    done = CliRunner().invoke(app, list(arguments))
    return done.exit_code, done.output


def test_fields_are_options_of_their_own():
    assert asked("A") == (0, "A 1.5 False 2\n")
    assert asked("A", "--times", "3", "--through", "--depth", "4") == (0, "A 4.0 True 3\n")


def test_an_options_limits_hold_and_what_is_no_option_is_refused():
    status, said = asked("A", "--depth", "-1")
    assert status == 2
    assert "--depth" in said
    assert asked("A", "--hole", "1")[0] == 2


def test_the_help_has_them_where_the_argument_stands():
    _, said = asked("--help")
    assert "Drill a hole." in said
    assert said.index("--depth") < said.index("--through") < said.index("--times")
