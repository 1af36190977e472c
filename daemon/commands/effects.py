"""``abbe effects``: the catalogue of effects, or one effect's page."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.options import AsJson

if TYPE_CHECKING:
    from rich.console import Console

    from abbe.compcore.effects.handbook import EffectPage


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("effects")(effects)


def effects(
    kind: Annotated[
        str | None, typer.Argument(help="Print this effect's page.", metavar="[KIND]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the catalogue of effects, or print the page of one of them."""
    from rich.console import Console

    from abbe.compcore.effects import effect_class, effect_kinds
    from abbe.compcore.effects.handbook import effect_page

    if kind is not None:
        page = effect_page(effect_class(kind))
        if as_json:
            typer.echo(json.dumps(page.as_json(), ensure_ascii=False))
        else:
            _print_page(Console(highlight=False), page)
        return
    pages = [effect_page(cls) for cls in effect_kinds().values()]
    if as_json:
        brief = ("kind", "scope", "chapter", "summary", "usage", "keys")
        listed = [{k: v for k, v in page.as_json().items() if k in brief} for page in pages]
        typer.echo(json.dumps({"effects": listed}, ensure_ascii=False))
        return
    _print_catalogue(Console(highlight=False), pages)


def _print_catalogue(console: Console, pages: list[EffectPage]) -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("kind", no_wrap=True)
    table.add_column("scope", no_wrap=True)
    table.add_column("what it is")
    chapter = ""
    for page in pages:
        if page.chapter != chapter:
            chapter = page.chapter
            table.add_section()
            table.add_row(Text(chapter, style="bold"), "", "")
        table.add_row(Text(f"  {page.kind}"), Text(page.scope), Text(_plain(page.summary)))
    console.print(table)
    console.print("One effect's page, for example: abbe effects backlash")


def _print_page(console: Console, page: EffectPage) -> None:
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    console.print(Text(page.kind, style="bold"), Text(f"  {page.chapter}, {page.scope}"))
    console.print()
    for paragraph in (page.summary, *page.text):
        console.print(Text(_plain(paragraph)))
        console.print()
    for title, body in page.sections.items():
        console.print(Text(title, style="bold"))
        for paragraph in body:
            console.print(Padding(Text(_plain(paragraph)), (0, 0, 0, 4)))
    console.print(Text("Keys", style="bold"))
    table = Table.grid(padding=(0, 2))
    for key in page.keys:
        default = "" if key.default is None else f" (default {key.default})"
        needed = "" if key.required else "optional: "
        table.add_row(Text(f"    {key.name}"), Text(needed + key.words + default))
    console.print(table)
    console.print(Text(f"    abbe add MODEL {page.usage} …"))


def _plain(text: str) -> str:
    return text.replace("``", "").replace("`", "")
