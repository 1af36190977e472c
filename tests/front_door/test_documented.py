"""Every exported name is documented: in its docstring, with all its parts, and on the page."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import abbe

PAGE = (Path(__file__).parents[2] / "docs" / "python.md").read_text("utf-8")


def undocumented(name: str, thing: Any) -> Iterator[str]:
    """What of a function or a class has no word of explanation."""
    own = _own(thing)
    if not own:
        yield f"{name}: no docstring"
    if inspect.isclass(thing):
        yield from _parts(name, thing)
    else:
        yield from _parameters(name, thing, own)


def _own(thing: Any) -> str:
    """Its docstring; a dataclass's signature, which Python makes up, is none."""
    text = (thing.__doc__ or "").strip()
    return "" if text.startswith(f"{thing.__name__}(") else text


def _parts(name: str, cls: type) -> Iterator[str]:
    ours = [c for c in cls.__mro__ if c.__module__.startswith(("abbe.", __name__))]
    text = " ".join(map(_own, ours))
    if dataclasses.is_dataclass(cls):
        for field in dataclasses.fields(cls):
            if not field.name.startswith("_") and not _named(field.name, text):
                yield f"{name}.{field.name}: not in the class's docstring"
    for base in ours:
        for part, value in list(vars(base).items()):
            explained = isinstance(value, property) or callable(value) or hasattr(value, "func")
            if part.startswith("_") or not explained or inspect.isclass(value):
                continue
            if not (inspect.getdoc(getattr(cls, part)) or inspect.getdoc(value)):
                yield f"{name}.{part}: no docstring"


def _parameters(name: str, function: Any, text: str) -> Iterator[str]:
    # what a parameter called `model` of type Model is needs no words
    known = {"model", "campaign", "machine", "path", "paths", "structure"}
    for parameter in inspect.signature(function).parameters:
        if parameter not in known and not _named(parameter, text):
            yield f"{name}({parameter}): not in the docstring"


def _named(word: str, text: str) -> bool:
    return re.search(rf"(?<!\w){re.escape(word)}(?!\w)", text) is not None


@pytest.mark.parametrize("name", abbe.__all__)
def test_docstring(name: str) -> None:
    assert list(undocumented(name, getattr(abbe, name))) == []


@pytest.mark.parametrize("name", abbe.__all__)
def test_page(name: str) -> None:
    assert f"`{name}`" in PAGE


def test_what_is_missing_is_seen() -> None:
    @dataclasses.dataclass
    class Bare:
        width: float

        def turn(self): ...

    def turn(angle):
        """Turn it."""

    assert list(undocumented("Bare", Bare)) == [
        "Bare: no docstring",
        "Bare.width: not in the class's docstring",
        "Bare.turn: no docstring",
    ]
    assert list(undocumented("turn", turn)) == ["turn(angle): not in the docstring"]
