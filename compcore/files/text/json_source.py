"""JSON from a file that anybody may have written: bounded, and its shape checked with its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.compcore.files.text.toml_source import dotted
from abbe.compcore.validation import first_invalid

MOST_BYTES = 8_000_000
"""Of a JSON file; parsing needs some forty times this."""

Shape = TypeVar("Shape", bound=BaseModel)


def read_json(path: str | Path) -> Any:
    """The content of a JSON file (UTF-8).

    Raises
    ------
    InputError
        When it cannot be read, is too long, nested too deeply, or not JSON; names the line.
    """
    return parse_json(read_bounded(path, MOST_BYTES), path)


def parse_json(text: str | bytes, file: str | Path | None = None, line: int | None = None) -> Any:
    """What JSON text says; `line` is the text's own where it is one line of a file.

    Raises
    ------
    InputError
        As `read_json`.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError("nested too deeply", file=file, line=line) from None
    except json.JSONDecodeError as error:
        problem = f"not JSON: {error.msg}"
        raise InputError(problem, file=file, line=line or error.lineno) from None
    except ValueError as error:
        raise InputError(f"not JSON: {error}", file=file, line=line) from None


def shaped(
    value: Any, shape: type[Shape], file: str | Path | None = None, line: int | None = None
) -> Shape:
    """What was read, as the sections that it must have.

    Raises
    ------
    InputError
        For the first key that is missing or of another type; names it.
    """
    try:
        return shape.model_validate(value)
    except ValidationError as error:
        first = first_invalid(error, value)
        raise InputError(
            first.problem, file=file, line=line, field=dotted(first.path) or None,
            found=first.found, expected=first.expected,
        ) from None  # fmt: skip
