"""Validation errors of pydantic in Abbe's words: the same for every section, key and option."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from difflib import get_close_matches
from types import UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from abbe.compcore.errors import InputError

Path = tuple[str | int, ...]
"""Keys, and places in lists, that lead to a value."""

_KINDS = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "dict_type": "a section",
    "model_type": "a section",
    "list_type": "a list",
    "tuple_type": "a list",
}
_MOST_KEYS = 12
"""Keys of a section that fit into a line."""
_LONGEST = 60
"""Characters of what was found that fit into a line."""


class Invalid(NamedTuple):
    """The first thing that is wrong.

    Attributes
    ----------
    kind
        pydantic's name of the fault: ``missing``, ``extra_forbidden``, …
    path
        Where.
    problem, found, expected
        As `InputError` has them.
    cause
        The `InputError` that a class's own check raised.
    """

    kind: str
    path: Path
    problem: str
    found: Any = None
    expected: str | None = None
    cause: InputError | None = None


def first_invalid(
    error: ValidationError, data: Any = None, prefix: Sequence[str | int] = ()
) -> Invalid:
    """The first error of a validation.

    Parameters
    ----------
    error
        What pydantic raised.
    data
        The whole that holds what was validated: names of union members and types, which are not in
        it, are left out of the path. None: the path stays as pydantic has it.
    prefix
        Path, in `data`, of the part that was validated.
    """
    first = error.errors()[0]
    kind: str = first["type"]
    path = (*prefix, *first["loc"])
    if data is not None:
        path = _in_data(data, path)
    context: Any = first.get("ctx", {})
    found = _short(first["input"])
    if kind == "extra_forbidden":
        known = _known(error.title, first["loc"][:-1])
        return Invalid(kind, path, "unknown key", path[-1], _one_of(str(path[-1]), known))
    if kind == "missing":
        last = path[-1] if path else ""
        longer = f"a key {last!r}" if isinstance(last, str) else f"{last + 1} elements or more"
        return Invalid(kind, path, "missing", expected=longer)
    if kind == "union_tag_not_found":
        return Invalid(kind, (*path, "type"), "missing", expected="a key 'type'")
    if kind == "union_tag_invalid":
        expected = "one of " + context["expected_tags"].replace("'", "")
        return Invalid(kind, (*path, "type"), "unknown type", context["tag"], expected)
    if kind == "literal_error":
        return Invalid(kind, path, "not allowed", found, context["expected"])
    if kind == "value_error":
        cause = context["error"]
        if isinstance(cause, InputError):
            return Invalid(kind, path, cause.problem, cause.found, cause.expected, cause)
        return Invalid(kind, path, str(cause))
    if kind in _KINDS:
        return Invalid(kind, path, "wrong kind of value", found, _KINDS[kind])
    words = first["msg"].removeprefix("Input should ").removeprefix("be ")
    return Invalid(kind, path, "not allowed", found, words)


def _one_of(asked: str, known: Collection[str]) -> str | None:
    """The keys that there are; of many those that are spelled alike, or none."""
    if len(known) > _MOST_KEYS:
        known = get_close_matches(asked, known)
    return "one of " + ", ".join(known) if known else None


def _known(root: str, path: Sequence[str | int]) -> list[str]:
    """The keys of a section, by the class that was validated and the way to it; empty: not known.

    Only where sections stand in sections, or under names of the user's own: where it may be one of
    several the way says too little.
    """
    classes = [c for c in _descendants(BaseModel) if c.__name__ == root]
    found: Any = classes[0] if len(classes) == 1 else None
    for key in path:
        fields = found.model_fields if _is_section(found) else {}
        if key in fields:
            found = _section(fields[str(key)].annotation)
        elif get_origin(found) in (dict, list, tuple, Mapping, Sequence):
            found = _section(get_args(found)[-1])
        else:
            return []
    if not _is_section(found):
        return []
    return [field.alias or name for name, field in found.model_fields.items()]


def _is_section(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, BaseModel)


def _section(annotation: Any) -> Any:
    """A type without what may stand in its place: ``Section | None`` is a section."""
    if get_origin(annotation) is Annotated:
        return _section(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        held = [_section(a) for a in get_args(annotation) if a is not type(None)]
        return held[0] if len(held) == 1 else None
    return annotation


def _descendants(cls: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for one in cls.__subclasses__():
        yield one
        yield from _descendants(one)


def invalid_key(
    error: ValidationError, what: str, known: Collection[str], noun: str = "key"
) -> InputError:
    """The first error of keys that a person gave by name.

    Parameters
    ----------
    error
        What pydantic raised.
    what
        What the keys are of: the error's field where it is of no single key.
    known
        The keys that there are.
    noun
        What a key is called.
    """
    first = first_invalid(error)
    field = str(first.path[0]) if first.path else what
    if first.kind == "extra_forbidden":
        return InputError(
            f"{what} has no such {noun}", field=field, expected="one of " + ", ".join(known)
        )
    if first.kind == "missing" and len(first.path) == 1:
        return InputError(f"{what} needs this {noun}", field=field)
    if first.cause is not None:
        return first.cause.at(field=field)
    return InputError(
        f"{what}: {first.problem}", field=field, found=first.found, expected=first.expected
    )


def in_one_line(error: ValidationError) -> str:
    """The first error for a log or a program that asked: what, where, found, expected."""
    first = first_invalid(error)
    field = ".".join(str(part) for part in first.path) or None
    return str(InputError(first.problem, field=field, found=first.found, expected=first.expected))


def _short(found: Any) -> Any:
    text = repr(found)
    return found if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def _in_data(data: Any, path: Path) -> Path:
    """A path without what is not in the data."""
    inside: list[str | int] = []
    here = data
    for i, part in enumerate(path):
        if part in (here if isinstance(here, dict) else _indices(here)):
            here = here[part]
        elif i == len(path) - 1 and _missing(here, part):
            here = None
        else:
            continue
        inside.append(part)
    return tuple(inside)


def _missing(here: Any, part: str | int) -> bool:
    """Whether the end of a path is a key, or an element, that should be there."""
    if isinstance(here, dict):
        return here.get("type") != part
    return isinstance(here, list) and isinstance(part, int)


def _indices(value: Any) -> range:
    return range(len(value)) if isinstance(value, list) else range(0)
