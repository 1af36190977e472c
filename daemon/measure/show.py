"""How a measurement is shown: a bar with the next target on a terminal, lines, or JSON lines."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from abbe.daemon.measure.events import MeasureEvent, Tell, minutes


@contextmanager
def telling(*, as_json: bool) -> Iterator[Tell]:
    """What tells a person, on standard output, what happens, while the context lasts."""
    if as_json:
        yield _json
    elif sys.stdout.isatty():
        with _bar() as tell:
            yield tell
    else:
        yield _line


def _json(event: MeasureEvent) -> None:
    typer.echo(json.dumps({"event": event.kind, "text": event.text, **event.about},
                          ensure_ascii=False))  # fmt: skip
    sys.stdout.flush()


def _line(event: MeasureEvent) -> None:
    left = event.about.get("left_s")
    progress = f"[{event.about.get('done', 0)}/{event.about.get('of', 0)}] "
    more = f", about {minutes(float(left))} left" if event.kind == "next" and left else ""
    typer.echo(progress + event.text + more)
    sys.stdout.flush()


@contextmanager
def _bar() -> Iterator[Tell]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn

    console = Console()
    columns = [
        BarColumn(bar_width=24),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.description}"),
    ]
    with Progress(*columns, console=console, auto_refresh=True) as bar:
        task = bar.add_task("", total=1.0, left="")

        def tell(event: MeasureEvent) -> None:
            left = event.about.get("left_s")
            bar.update(
                task,
                completed=event.about.get("done", 0),
                total=event.about.get("of", 1),
                left="" if left is None else f"about {minutes(float(left))} left",
            )
            if event.kind == "next":
                bar.update(task, description=escape(event.text))
                return
            colour = {"row": "", "repeated": "", "done": "green", "set up": "bold cyan",
                      "back": "green"}.get(event.kind, "yellow")  # fmt: skip
            text = escape(event.text)
            with contextlib.suppress(OSError):
                console.print(f"[{colour}]{text}[/]" if colour else text, highlight=False)

        yield tell
