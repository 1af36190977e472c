"""What pydantic found wrong, in Abbe's words."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.json_source import shaped
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.validation import in_one_line, invalid_key


def below_ten(value: float) -> float:
    if value >= 10.0:
        raise InputError("too large", found=value, expected="less than 10")
    return value


class Line(BaseModel):
    type: Literal["line"]
    scale: float = 1.0


class Circle(BaseModel):
    type: Literal["circle"]
    centre: tuple[float, float] = (0.0, 0.0)


class File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(strict=True)]
    most: Annotated[float, AfterValidator(below_ten)] = 1.0
    parts: list[Annotated[Line | Circle, Field(discriminator="type")]] = []
    number: Annotated[int, Field(ge=1)] | tuple[int, int] = 1


WRONG: dict[str, tuple[str, str]] = {
    "missing key": ("", "field 'name': missing: expected a key 'name'"),
    "unknown key": ('name = "a"\nsize = 3\n', "line 2, field 'size': unknown key: found 'size'"),
    "kind": ("name = 3\n", "line 1, field 'name': wrong kind of value: found 3, expected a text"),
    "a check's own words": (
        'name = "a"\nmost = 12.0\n',
        "line 2, field 'most': too large: found 12.0, expected less than 10",
    ),
    "type missing": (
        'name = "a"\n[[parts]]\nscale = 1\n',
        "line 2, field 'parts[0].type': missing: expected a key 'type'",
    ),
    "unknown type": (
        'name = "a"\n[[parts]]\ntype = "square"\n',
        "line 3, field 'parts[0].type': unknown type: found 'square', expected one of line, circle",
    ),
    "the union's member is no key": (
        'name = "a"\n[[parts]]\ntype = "line"\nscale = "much"\n',
        "line 4, field 'parts[0].scale': wrong kind of value: found 'much', expected a number",
    ),
    "list too short": (
        'name = "a"\n[[parts]]\ntype = "circle"\ncentre = [1.0]\n',
        "line 4, field 'parts[0].centre[1]': missing: expected 2 elements or more",
    ),
    "bound": (
        'name = "a"\nnumber = 0\n',
        "line 2, field 'number': not allowed: found 0, expected greater than or equal to 1",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_first_fault_of_a_file(case: str):
    text, words = WRONG[case]
    source = TomlSource(text, "a.toml")
    with pytest.raises(ValidationError) as caught:
        File.model_validate(source.data)
    assert str(source.invalid(caught.value)).startswith(f"a.toml, {words}")


@pytest.mark.parametrize("case", WRONG)
def test_the_same_words_for_json(case: str):
    text, words = WRONG[case]
    with pytest.raises(InputError) as caught:
        shaped(TomlSource(text).data, File, "a.json")
    assert words.partition("field")[2] in str(caught.value)


def test_a_section_is_named_from_the_top_of_its_file():
    source = TomlSource('[links.cmm]\ntype = "line"\nscale = "much"\n', "a.toml")
    with pytest.raises(ValidationError) as caught:
        Line.model_validate(source.data["links"]["cmm"])
    error = source.invalid(caught.value, ("links", "cmm"))
    assert (error.line, error.field) == (3, "links.cmm.scale")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "field 'name': map needs this option"),
        ({"name": "a", "size": 3}, "field 'size': map has no such option: expected one of name,"),
        ({"name": "a", "most": 11}, "field 'most': too large: found 11.0, expected less than 10"),
        ({"name": "a", "most": "x"}, "field 'most': map: wrong kind of value: found 'x', expected"),
    ],
)
def test_keys_that_a_person_gave(keys: dict[str, Any], words: str):
    with pytest.raises(ValidationError) as caught:
        File(**keys)
    assert str(invalid_key(caught.value, "map", File.model_fields, "option")).startswith(words)


def test_what_was_found_is_cut_to_a_line():
    with pytest.raises(InputError) as caught:
        shaped({"name": list(range(1000))}, File)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"name": 3}, "field 'name': wrong kind of value: found 3, expected a text in quotes"),
        (
            {"name": "a", "parts": [{"type": "line", "scale": "much"}]},
            "field 'parts.0.line.scale': wrong kind of value: found 'much', expected a number",
        ),
        ({"name": list(range(1000))}, "field 'name': wrong kind of value: found '[0, 1,"),
    ],
)
def test_one_line_for_a_log(keys: dict[str, Any], words: str):
    with pytest.raises(ValidationError) as caught:
        File(**keys)
    line = in_one_line(caught.value)
    assert line.startswith(words)
    assert len(line) < 200
    assert "\n" not in line
