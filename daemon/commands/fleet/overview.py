"""``abbe fleet``: every machine, how it is, whether its model still holds."""

from __future__ import annotations

import json

import typer

from abbe.daemon.arguments.fleet import MachineType, Site, StoreUrl, require_store
from abbe.daemon.arguments.options import AsJson, Force, Report


def register(fleet: typer.Typer) -> None:
    """Make it what the group does by itself."""
    fleet.callback(invoke_without_command=True)(overview)


def overview(
    context: typer.Context,
    store: StoreUrl = "",
    site: Site = "",
    kind: MachineType = "",
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """The machines of a plant: health, last seen, age of the model, alarms, drift.

    Those that need somebody come first. Asked of the plant's store; [fleet] in a machine's
    configuration has its records uploaded there.

    An example: abbe fleet --store postgresql://quality@store.plant.example/abbe
    """
    if context.invoked_subcommand is not None:
        return
    from abbe.daemon.answers.fleet import overview as answer
    from abbe.daemon.fleet.asked.reading import FleetStore
    from abbe.daemon.fleet.store.connecting import opened_store
    from abbe.daemon.outputs import REPORT, check_outputs
    from abbe.daemon.report.fleet import fleet_page

    say = check_outputs([], [(report, REPORT)], force=force, as_json=as_json)
    with opened_store(require_store(store)) as connection:
        found = answer.overview(FleetStore(connection).machines(site, kind))
    if report is not None:
        fleet_page(found).write(report)
    if as_json:
        machines = [h.as_json() for h in found]
        say(json.dumps({"machines": machines}, ensure_ascii=False))
        return
    _print(answer.headline(found), answer.COLUMNS, answer.rows(found))
    if report is not None:
        say(f"written: {report}")


def _print(headline: str, columns: tuple[str, ...], rows: list[list[str]]) -> None:
    from rich.console import Console
    from rich.table import Table

    typer.echo(headline)
    if not rows:
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        table.add_column(column, overflow="fold")
    colours = {"alarm": "red", "attention": "yellow", "good": "green", "unknown": "dim"}
    for row in rows:
        colour = colours[row[3].partition(":")[0]]
        cells = [_plain(cell) for cell in row]
        cells[3] = f"[{colour}]{cells[3]}[/{colour}]"
        table.add_row(*cells)
    console = Console()
    wide = console.width if console.is_terminal else 200
    Console(width=wide).print(table, highlight=False)


def _plain(cell: str) -> str:
    from rich.markup import escape

    return escape(cell)
