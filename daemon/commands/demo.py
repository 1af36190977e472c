"""``abbe demo``: a simulated machine is measured, modelled and corrected live, in one command."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.answers.typed import checking
from abbe.daemon.arguments.bounded import within
from abbe.daemon.arguments.options import Force

if TYPE_CHECKING:
    from rich.console import Console

    from abbe.daemon.status.figures import Figures

DRIFT_TIME = 4200.0
"""Shop time that the live part spans, s: the shop warms by 1.8 K in the first hour."""


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("demo")(demo)


def demo(
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object a cycle, then a summary.")
    ] = False,
    duration: Annotated[
        float, typer.Option(callback=within(5.0, 1e6, "s"), help="Seconds of live correction.")
    ] = 40.0,
    seed: Annotated[int, typer.Option(min=0, max=2**31, help="Which simulated machine.")] = 1,
    folder: Annotated[
        Path, typer.Option("--out", help="Folder for campaign, model and configuration.")
    ] = Path("demo-out"),
    force: Force = False,
) -> None:
    """Measure a simulated CMM, fit its model, and correct it live over Modbus while it warms up."""
    from rich.console import Console

    from abbe.compcore.files.text.atomic import write_atomically
    from abbe.daemon.config import load_config
    from abbe.daemon.demo.configuration import demo_configuration
    from abbe.daemon.demo.prepare import Workshop, prepare
    from abbe.daemon.demo.simulator import simulated_bridge
    from abbe.daemon.demo.workbench import demo_workbench
    from abbe.daemon.service import Service
    from abbe.daemon.show.attach import choose, run_in_view

    how = choose(as_json)
    console = Console(file=sys.stdout if how == "screen" else sys.stderr)
    shop = Workshop(folder)
    shop.forget_address()
    if not force:
        shop.require_own()

    @contextmanager
    def step(name: str) -> Iterator[Callable[[str], None]]:
        outcome: list[str] = []
        with console.status(f"{name} …"):
            yield outcome.append
        console.print(f"[green]✓[/green] {name}: {''.join(outcome)}", highlight=False)

    console.print("[bold]A bridge CMM becomes more accurate than its mechanics[/bold]")
    prepare(seed, shop, step)
    with simulated_bridge(seed, DRIFT_TIME / duration) as machine:
        with step("Start the machine in a process of its own") as done:
            text = demo_configuration(
                machine.ready, shop.model.name, records=True, http=shop.socket_fits
            )
            write_atomically(shop.config, text)
            configuration = load_config(shop.config)
            done(f"Modbus TCP at {machine.host}:{machine.port}, linked by {shop.config}")
        with demo_workbench(shop) as address:
            console.print(f"See it in a browser on this computer:  {address}", soft_wrap=True)
            console.print(
                f"Correcting it live for {duration:g} s, while its shop warms up as in an hour. "
                "Ctrl-C ends.\n"
            )
            figures = run_in_view(
                lambda: Service(configuration),
                how,
                "Abbe demo · " + configuration.model.machine.name,
                duration,
                lambda found: {"summary": found.summary()},
            )
    _tell(console, figures, shop.folder)


def _tell(console: Console, figures: Figures, folder: Path) -> None:
    drift = figures.drift()
    scales = [change for name, change in drift.items() if name != "T_amb"]
    if not figures.after.count or not scales:
        console.print("Ended before the machine was corrected in full; no figures.")
        return
    before, after = figures.before, figures.after
    console.print(
        f"\nVolumetric error along the path, against the simulated truth "
        f"({after.count} cycles):\n"
        f"  before  {before.rms:6.2f} µm rms  {before.max:6.2f} µm largest\n"
        f"  after   {after.rms:6.2f} µm rms  {after.max:6.2f} µm largest   "
        f"[bold green]{figures.improvement:.0f} times smaller[/bold green]\n"
        f"while the scales warmed by {min(scales):.2f} to {max(scales):.2f} K. "
        f"Cycle: {figures.cycle_ms(0.5):.2f} ms median, {figures.cycle_ms(0.99):.2f} ms in 99 %.\n"
        f"\nWhat to look at next: the measurements, the model and the configuration in {folder}/; "
        f"`{checking(folder / 'config.toml')}`; docs/demo.md says what happened, "
        "docs/daemon.md how to link your own controller.",
        highlight=False,
        soft_wrap=not console.is_terminal,
    )
