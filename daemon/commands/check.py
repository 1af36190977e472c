"""``abbe check``: validate a configuration and print an overview of its links and channels."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

from abbe.daemon.arguments.options import AsJson, ConfigFile

if TYPE_CHECKING:
    from rich.table import Table

_WIDTH = 220
"""Columns where standard output is not a terminal."""


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("check")(check)


def check(
    config: ConfigFile,
    as_json: AsJson = False,
) -> None:
    """Validate a configuration and print what would be linked; opens nothing."""
    from rich.console import Console
    from rich.markup import escape

    from abbe.daemon.answers.overview import overview
    from abbe.daemon.config import load_config

    found = overview(load_config(config))
    if as_json:
        typer.echo(json.dumps(found, ensure_ascii=False))
        return
    console = Console()
    if not console.is_terminal:
        console.width = _WIDTH
    model, guard, cycle = found["model"], found["guard"], found["cycle"]
    console.print(
        f"[bold]{model['name']}[/bold], structure {model['structure']}, model {model['file']}: "
        f"{model['fitted']} of {model['effects']} effects fitted"
    )
    if not model["fitted"]:
        console.print("[yellow]No effect is fitted: nothing would be corrected.[/yellow]")
    for name, link in found["links"].items():
        console.print(f"link {name}: driver {link['driver']}, {link['channels']} channels")
    console.print(_table("Read", found["inputs"], "becomes"))
    console.print(_table("Written", found["outputs"], "from"))
    limits = ", ".join(f"{d} {v:g}" for d, v in guard["max_correction_um"].items())
    console.print(
        f"Guard: correction at most {limits} µm, vector {guard['max_norm_um']:g} µm, "
        f"changing at most {guard['max_rate_um_per_s']:g} µm/s.\n"
        f"{_turns(guard)}"
        f"Positions are stale after {guard['stale_after_s']:g} s, signals after "
        f"{guard['signals_stale_after_s']:g} s; then the last good correction is held for "
        f"{guard['hold_s']:g} s and ramped to zero in {guard['ramp_s']:g} s.\n"
        f"Cycle: every {cycle['period_s']:g} s, signals every {cycle['signals_every_s']:g} s."
    )
    if "published" in found:
        to = found["published"]
        words = f"Published: every {to['every_s']:g} s to {to['to']}, below {to['below']}."
        console.print(words, markup=False, highlight=False)
    if "uploaded" in found:
        to = found["uploaded"]
        words = (
            f"Uploaded: every {to['every_s']:g} s to {to['to']}, as {to['machine']} of site "
            f"{to['site']}."
        )
        console.print(words, markup=False, highlight=False)
    for note in found["notes"]:
        console.print(f"[yellow]Note:[/yellow] {escape(note)}.", highlight=False)
    console.print("[green]The configuration is in order.[/green]", highlight=False)


def _turns(guard: dict[str, Any]) -> str:
    """What rotary axes may be turned by, a line; empty where none is."""
    if "max_turn_deg" not in guard:
        return ""
    limits = ", ".join(f"{axis} {most:g}" for axis, most in guard["max_turn_deg"].items())
    return (
        f"Rotary axes turned by at most {limits} degrees, changing at most "
        f"{guard['max_turn_rate_deg_per_s']:g} degrees/s; then all directions are held and ramped "
        "together.\n"
    )


def _table(title: str, rows: list[dict[str, Any]], last: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for heading in ("what", "channel", "where", "transducer", last):
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(
            row["what"], row["channel"], row["where"], row["transducer"] or "–", row[last]
        )
    return table
