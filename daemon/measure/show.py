"""How a measurement is shown: a bar with the next target on a terminal, lines, or JSON lines."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import typer

from abbe.compcore.sentences import Sentence, said
from abbe.daemon.measure.events import MeasureEvent, Tell, minutes


@contextmanager
def telling(*, as_json: bool, say: Callable[[str], str] = str) -> Iterator[Tell]:
    """What tells a person, on standard output, what happens, while the context lasts.

    Parameters
    ----------
    say
        Gives a text in the language of who reads it.
    """
    if as_json:
        yield _json
    elif sys.stdout.isatty():
        with _bar(say) as tell:
            yield tell
    else:
        yield partial(_line, say)


def _json(event: MeasureEvent) -> None:
    typer.echo(json.dumps({"event": event.kind, "text": event.text, **event.about},
                          ensure_ascii=False))  # fmt: skip
    sys.stdout.flush()


def _line(say: Callable[[str], str], event: MeasureEvent) -> None:
    left = event.about.get("left_s")
    progress = f"[{event.about.get('done', 0)}/{event.about.get('of', 0)}] "
    more = f", {say(_left(left))}" if event.kind == "next" and left else ""
    typer.echo(progress + say(event.text) + more)
    sys.stdout.flush()


def _left(seconds: object) -> Sentence:
    """What a time that is left is called."""
    return said("about {time} left", time=minutes(float(str(seconds))))


@contextmanager
def _bar(say: Callable[[str], str]) -> Iterator[Tell]:
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
                left="" if left is None else say(_left(left)),
            )
            if event.kind == "next":
                bar.update(task, description=escape(say(event.text)))
                return
            colour = {"row": "", "repeated": "", "done": "green", "set up": "bold cyan",
                      "back": "green"}.get(event.kind, "yellow")  # fmt: skip
            text = escape(say(event.text))
            with contextlib.suppress(OSError):
                console.print(f"[{colour}]{text}[/]" if colour else text, highlight=False)

        yield tell
