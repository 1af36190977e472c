"""The catalogue as a handbook: an effect's page out of its docstring and its where-keys."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import Any, get_args

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.registry import chapter

SECTIONS = ("Formula", "Parameters", "Signals", "Typical causes", "Cure", "Source")
"""The sections that every page has, in order."""

KEY_WORDS = {
    "axis": "the axis whose error motion it is",
    "axes": "two axes in the structure's order, workpiece to tool",
    "direction": "direction of the error: X, Y or Z",
    "about": "direction about which it turns: X, Y or Z",
    "by": "the other axis, on whose position it depends",
    "channel": "the error motion: E_XX, E_ZY, …; dX, dY or dZ",
    "error": "the error motion: E_ZX, …",
    "signal": "a recorded signal",
    "signals": "recorded signals, comma-separated",
    "setup": "a set-up of the campaign",
    "setups": "set-ups of the campaign, comma-separated",
    "base": "a base point of distances",
    "shape": "constant, polynomial:N, spline:N or table",
    "positions": "a table's positions, mm (rotary axes degrees), comma-separated",
    "within": "the angles in degrees beyond which the value of that end is held",
    "harmonics": "number of harmonics",
    "period": "period in mm; fitted where it is left out",
    "tau": "time constant in s",
    "tau2": "time constant in s of a second body behind the same signal",
    "start": "fit: how warm the body was when its run began is fitted in each run",
    "along": "direction of the carried part while the axis stands at 0: X, Y or Z",
    "gravity": "fit: the machine stands tilted; else along −Z",
    "t0": "moment in s; fitted where it is left out",
    "number": "which of several, from 2 on; none for the first",
    "across": "X, Y or Z: along which its two drives are apart",
    "master": "where the master's scale is along that, all axes at zero, mm",
    "slave": "where the slave's scale is, mm",
    "centre": "centre in mm; fitted where it is left out",
    "over": "length in mm over which it steps",
    "width": "full width at half height in mm; fitted where it is left out",
    "product": "true: times the axis's own position",
    "deflection": "true: with the beam's own bending line",
    "root": "position in mm at which nothing overhangs",
    "fixed": "position of the fixed bearing in mm",
    "datum": "the point that is held fixed: x,y,z in mm",
    "measures": "length, or angle where the set-up measures one",
    "terms": "expressions, comma-separated",
    "file": "the grid's data, in the model's folder or below it",
    "sha256": "checksum of that file",
    "tool": "tool offset with which a grid was measured: x,y,z in mm",
}
"""Where-key → what it says."""


@dataclass(frozen=True, slots=True)
class Key:
    """A where-key of an effect: `default` None where it is required or has none."""

    name: str
    required: bool
    default: str | None
    words: str


@dataclass(frozen=True)
class EffectPage:
    """An effect's page.

    Attributes
    ----------
    kind, scope, chapter
        As in the catalogue.
    summary
        One sentence.
    text
        What it is, further; paragraphs.
    sections
        Title (`SECTIONS`) → paragraphs of text.
    keys
        The where-keys.
    """

    kind: str
    scope: str
    chapter: str
    summary: str
    text: tuple[str, ...]
    sections: dict[str, tuple[str, ...]]
    keys: tuple[Key, ...]

    @property
    def usage(self) -> str:
        """How ``abbe add`` takes it; optional keys in brackets."""
        parts = [self.kind]
        for key in self.keys:
            value = f"{key.name}={key.default or '…'}"
            parts.append(value if key.required else f"[{value}]")
        return " ".join(parts)

    def as_json(self) -> dict[str, Any]:
        """The page as plain data."""
        return {
            "kind": self.kind,
            "scope": self.scope,
            "chapter": self.chapter,
            "summary": self.summary,
            "text": list(self.text),
            "sections": {title: list(body) for title, body in self.sections.items()},
            "usage": self.usage,
            "keys": [
                {
                    "name": key.name,
                    "required": key.required,
                    "default": key.default,
                    "description": key.words,
                }
                for key in self.keys
            ],
        }


def effect_page(cls: type[Effect]) -> EffectPage:
    """The page of an effect kind, built in or from a plugin."""
    blocks = _blocks(inspect.getdoc(cls) or cls.kind)
    opening = blocks.pop("")
    keys = [_key(name, info) for name, info in cls.model_fields.items()]
    keys.sort(key=lambda key: (not key.required, _order(key.name)))
    return EffectPage(
        cls.kind,
        cls.scope,
        chapter(cls),
        opening[0] if opening else cls.kind,
        tuple(opening[1:]),
        {title: tuple(body) for title, body in blocks.items()},
        tuple(keys),
    )


def _blocks(text: str) -> dict[str, list[str]]:
    """Section title (opening: empty) → paragraphs."""
    found: dict[str, list[str]] = {"": []}
    title, paragraph = "", list[str]()

    def close() -> None:
        if paragraph:
            found[title].append(" ".join(paragraph))
            paragraph.clear()

    for line in text.splitlines():
        bare = line.strip()
        if line in SECTIONS:
            close()
            title = line
            found[title] = []
        elif not bare or set(bare) == {"-"}:
            close()
        else:
            paragraph.append(bare)
    close()
    return found


def _order(name: str) -> int:
    names = list(KEY_WORDS)
    return names.index(name) if name in names else len(names)


def _key(name: str, info: FieldInfo) -> Key:
    words = info.description or KEY_WORDS.get(name, "")
    default = info.default
    if name == "tau":
        words += (
            "; fit: fitted; left out: no lag"
            if "fit" in _literals(info.annotation)
            else "; fitted where it is left out"
        )
    if default in (None, (), PydanticUndefined):
        return Key(name, info.is_required(), None, words)
    if isinstance(default, bool):
        return Key(name, False, str(default).lower(), words)
    if isinstance(default, tuple):
        return Key(name, False, ",".join(f"{value:g}" for value in default), words)
    return Key(name, False, str(default), words)


def _literals(annotation: Any) -> set[Any]:
    found: set[Any] = set()
    for part in get_args(annotation):
        found |= _literals(part) or {part}
    return found
