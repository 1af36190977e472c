"""What pydantic found wrong with a section, as one `InputError` with file, line and key."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.toml_source import TomlSource, dotted

Path = tuple[str | int, ...]

_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "dict_type": "a section",
    "tuple_type": "a list",
    "list_type": "a list",
    "finite_number": "a finite number",
}


def told(
    source: TomlSource, error: ValidationError, prefix: Sequence[str | int] = ()
) -> InputError:
    """The first error of a validation, in the words of the file.

    Parameters
    ----------
    source
        The file.
    error
        What pydantic raised.
    prefix
        Key path of the section that was validated.
    """
    first = error.errors()[0]
    path = _in_file(source.data, (*prefix, *first["loc"]))
    context: Any = first.get("ctx", {})
    kind, found = first["type"], first["input"]
    if kind == "extra_forbidden":
        return source.error("unknown key", path, found=path[-1])
    if kind == "missing":
        return source.error("missing", path, expected=f"a key {dotted(path[-1:])!r}")
    if kind == "union_tag_not_found":
        return source.error("missing", (*path, "type"), expected="a key 'type'")
    if kind == "union_tag_invalid":
        return source.error(
            "unknown type",
            (*path, "type"),
            found=context["tag"],
            expected="one of " + context["expected_tags"].replace("'", ""),
        )
    if kind == "literal_error":
        return source.error("not allowed", path, found=found, expected=context["expected"])
    if kind == "string_pattern_mismatch":
        return source.error("not a channel", path, found=found, expected='"link.channel"')
    if kind == "value_error":
        return source.error(str(context["error"]), path)
    if kind in _EXPECTED:
        return source.error("wrong kind of value", path, found=found, expected=_EXPECTED[kind])
    words = re.sub(r"^Input should (?:be )?", "", first["msg"])
    return source.error("not allowed", path, found=found, expected=words)


def _in_file(data: Any, location: Sequence[str | int]) -> Path:
    """A location without what is not in the file: names of union members and types."""
    path: list[str | int] = []
    here = data
    last = len(location) - 1
    for i, part in enumerate(location):
        if part in (here if isinstance(here, dict) else _indices(here)):
            here = here[part]
        elif isinstance(here, dict) and i == last and here.get("type") != part:
            here = None
        else:
            continue
        path.append(part)
    return tuple(path)


def _indices(value: Any) -> range:
    return range(len(value)) if isinstance(value, list) else range(0)
