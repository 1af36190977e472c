"""docs/model.md: its examples load, hold everything that can stand in a file, and name each key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from abbe.compcore.effects import effect_kinds
from abbe.compcore.effects.shapes import Shape
from abbe.compcore.files.model_file import load_model, parse_model, save_model
from abbe.compcore.files.model_toml import sections as model_sections
from abbe.compcore.files.model_toml.sections import ModelSections, ParameterSection
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import ROLES

PAGE = (Path(__file__).parents[2] / "docs" / "model.md").read_text("utf-8")
SMALLEST, COMPLETE = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
TABLES = "\n".join(line for line in PAGE.splitlines() if line.startswith("|"))


def sections(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A section and all that stand in it."""
    yield kind
    for field in kind.model_fields.values():
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from sections(part)


RECORDS = [model_sections._Fit, model_sections._Record]
SECTIONS = [
    section for top in (ModelSections, ParameterSection, *RECORDS) for section in sections(top)
]
WHERE = sorted({key for kind in effect_kinds().values() for key in kind.model_fields})


def test_all_sections_are_found() -> None:
    classes = [
        kind
        for kind in vars(model_sections).values()
        if isinstance(kind, type)
        and issubclass(kind, BaseModel)
        and kind.__module__ == model_sections.__name__
        and kind.model_fields
    ]
    assert set(classes) == set(SECTIONS)


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.__name__)
def test_every_key_of_every_section_is_named(section: type[BaseModel]) -> None:
    for key in section.model_fields:
        row = rf"^\|.*`{key}`"
        heading = rf"^## .*`\[+{key}\]+`" if section is ModelSections else row
        found = re.search(row, PAGE, re.MULTILINE) or re.search(heading, PAGE, re.MULTILINE)
        assert found or f"`[machine.{key}.NAME]`" in PAGE, f"{section.__name__}.{key}"


def test_every_key_of_every_effect_is_named_with_what_it_says() -> None:
    first = "\n".join(line.split("|")[1] for line in TABLES.splitlines())
    assert [key for key in WHERE if f"`{key}`" not in first] == []


def test_every_role_and_shape_is_named() -> None:
    assert [role for role in ROLES if f"`{role}`" not in TABLES] == []
    for shape in ("constant", "polynomial:N", "spline:N", "table"):
        assert f'| `"{shape}"` |' in PAGE
    assert Shape.parse("polynomial:2").names == ("c0", "c1", "c2")
    assert Shape.parse("spline:2").names == ("c1", "c2")


def test_the_smallest_example_loads() -> None:
    model = parse_model(TomlSource(SMALLEST))
    assert [effect.spec for effect in model.effects] == ["squareness axes=Y,X"]


def test_the_complete_example_loads_and_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(COMPLETE, "utf-8")
    model = load_model(path)
    fitted = {term.effect.kind for term in model.terms if term.fitted}
    assert fitted == {"positioning", "squareness", "scale_expansion"}
    save_model(model, tmp_path / "again.toml")
    assert load_model(tmp_path / "again.toml") == model


def test_the_complete_example_holds_every_key_that_there_is() -> None:
    data = tomllib.loads(COMPLETE)
    written = set(keys_in(data))
    for section in SECTIONS:
        missing = set(section.model_fields) - written - {"covariance"}
        assert not missing, section.__name__
    used = {key for effect in data["effects"] for key in effect}
    commented = set(re.findall(r"^# (\w+) = ", COMPLETE, re.MULTILINE))
    assert set(WHERE) - used - commented == set()
    assert {"kind", "parameters"} == used - set(WHERE)


def keys_in(data: Any) -> Iterator[str]:
    """All keys of nested tables and lists."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield key
            yield from keys_in(value)
    elif isinstance(data, list):
        for value in data:
            yield from keys_in(value)
