"""``python -m tools.effect_pages``: docs/effects/ out of the effects' docstrings, with pictures."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from abbe.compcore.effects import NonlinearParameter, Parameter, effect_class, effect_kinds
from abbe.compcore.effects.handbook import EffectPage, effect_page
from abbe.compcore.effects.registry import FAMILIES
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.units import read_in
from tools.effect_pictures import picture
from tools.effect_scenes import SCENES

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "effects"
_NOTE = "<!-- Made by `python -m tools.effect_pages` from the effect's docstring. -->"
_NAME = re.compile(r"(?<!`)`([a-z_]+)`(?!`)")


def built_in() -> list[str]:
    """The kinds that have a page here: plugins have their own."""
    return [k for k, cls in effect_kinds().items() if cls.__module__.startswith("abbe.compcore.")]


def _markdown(text: str) -> str:
    """A docstring's paragraph in Markdown, other effects linked."""
    kinds = set(built_in())

    def link(match: re.Match[str]) -> str:
        name = match[1]
        return f"[{name}]({name}.md)" if name in kinds else f"`{name}`"

    return _NAME.sub(link, text).replace("``", "`")


def page_text(kind: str) -> str:
    """An effect's page in Markdown."""
    page = effect_page(effect_class(kind))
    lines = [_NOTE, "", f"# {kind}", "", f"*{page.chapter}; scope: {page.scope}*", ""]
    lines += [_markdown(page.summary), ""]
    lines += [f"![{SCENES[kind].caption}]({kind}.svg)", ""]
    for paragraph in page.text:
        lines += [_markdown(paragraph), ""]
    for title, body in page.sections.items():
        lines += [f"## {title}", ""]
        for paragraph in body:
            lines += [_markdown(paragraph), ""]
        if title == "Parameters" and not effect_class(kind).given:
            lines += _parameters(kind)
    usage = f"abbe add MODEL {page.usage} …"
    if effect_class(kind).given:
        usage = "abbe import-grid FILE --controller NAME --onto MODEL -o OUT"
    lines += ["## Keys", "", f"    {usage}", ""]
    lines += ["| key | | what it says |", "| --- | --- | --- |"]
    for key in page.keys:
        needed = "required" if key.required else "optional"
        if key.default is not None:
            needed += f", default `{key.default}`"
        lines.append(f"| `{key.name}` | {needed} | {key.words} |")
    return "\n".join([*lines, "", _back(page), ""])


def _back(page: EffectPage) -> str:
    return f"[All effects](README.md) · `abbe effects {page.kind}`"


def _parameters(kind: str) -> list[str]:
    """The parameters of the picture's example, with units and plausible ranges."""
    scene = SCENES[kind]
    effect = scene.effect(kind)
    rows = [
        f"As in the picture, `{effect.spec}`:",
        "",
        "| parameter | | plausible |",
        "| --- | --- | --- |",
    ]
    parameters: list[Parameter | NonlinearParameter] = [*effect.linear(scene.machine)]
    parameters += effect.nonlinear(scene.machine)
    for p in parameters:
        unit, factor = read_in(p)
        low, high = (f"{factor * end:.4g}" for end in p.plausible)
        rows.append(f"| `{p.name}` | {p.description} | {low} … {high} {unit} |")
    return [*rows, ""]


def index_text() -> str:
    """The list of all pages, by chapter."""
    lines = [
        "<!-- Made by `python -m tools.effect_pages`. -->",
        "",
        "# The catalogue of effects",
        "",
        "An effect is one physical cause of error. Each has a page: what it is, its formula, its",
        "parameters with units and plausible range, the signals it needs, typical causes, cure and",
        "source, and a picture of what it does to the volume. `abbe effects` lists them, and",
        "`abbe effects KIND` prints a page. Units and signs: [conventions](../conventions.md).",
        "",
        "Effects of the machine are compensated, effects of the workpiece too, apart; effects of",
        "the instrument are fitted and shown, and never compensated.",
    ]
    pages = [effect_page(effect_class(kind)) for kind in built_in()]
    for chapter in dict.fromkeys(FAMILIES.values()):
        lines += ["", f"## {chapter}", "", "| kind | what it is |", "| --- | --- |"]
        lines += [
            f"| [{page.kind}]({page.kind}.md) | {_markdown(page.summary)} |"
            for page in pages
            if page.chapter == chapter
        ]
    return "\n".join([*lines, ""])


def files() -> dict[str, str]:
    """File name → text, of everything in docs/effects/."""
    made = {"README.md": index_text()}
    for kind in built_in():
        made[f"{kind}.md"] = page_text(kind)
        made[f"{kind}.svg"] = picture(kind, SCENES[kind])
    return made


def main() -> None:
    """Write the pages; remove those of effects that are gone."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    made = files()
    for name, text in made.items():
        write_atomically(FOLDER / name, text)
    for old in FOLDER.iterdir():
        if old.name not in made:
            old.unlink()
    sys.stdout.write(f"{len(made)} files in {FOLDER}\n")


if __name__ == "__main__":
    main()
