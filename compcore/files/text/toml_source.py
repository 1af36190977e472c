"""TOML text with its line numbers: so that an error can say where in the file it is."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.bounded_text import read_bounded
from abbe.compcore.files.text.toml_bounds import MOST_BYTES, check_bounds
from abbe.compcore.validation import first_invalid

_HEADER = re.compile(r"^\s*(\[\[?)\s*(.+?)\s*\]\]?\s*(?:#.*)?$")
_LONG_QUOTES = ('"""', "'''")
_KEY = re.compile(r"^\s*([A-Za-z0-9_\-.\"']+)\s*=")


class TomlSource:
    """A parsed TOML document and where its keys stand.

    Raises
    ------
    InputError
        When the file cannot be read, asks for more than `abbe.compcore.files.text.toml_bounds`
        allows, or is not TOML; names file and line.
    """

    def __init__(self, text: str, file: str | None = None) -> None:
        self.file = file
        self.text = text
        check_bounds(text, file)
        try:
            self.data: dict[str, Any] = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            place = re.search(r"\(at line (\d+), column \d+\)", str(error))
            problem = re.sub(r"\s*\(at .*\)", "", str(error))
            at_end = text.count("\n") + 1
            raise InputError(
                f"not valid TOML: {problem}", file=file, line=int(place[1]) if place else at_end
            ) from None
        except ValueError:
            # Python converts no number of thousands of digits
            raise InputError("not valid TOML: a number of too many digits", file=file) from None

    @classmethod
    def read(cls, path: str | Path) -> TomlSource:
        """Read a file (UTF-8)."""
        text = read_bounded(path, MOST_BYTES, expected="a TOML file")
        return cls(text.replace("\r\n", "\n"), str(path))

    def line_of(self, path: Sequence[str | int]) -> int | None:
        """The line (from 1) on which a key stands, or the nearest enclosing section; else None.

        `path` is a key path such as ``("effects", 2, "shape")``.
        """
        best: tuple[int, int] | None = None  # (matched depth, line)
        current: list[str | int] = []
        counts: dict[tuple[str | int, ...], int] = {}  # array of tables → index of its last
        inside: str | None = None  # quotes of a string that runs over several lines
        for number, line in enumerate(self.text.splitlines(), start=1):
            if inside is not None:
                inside = None if inside in line else inside
                continue
            inside = next((q for q in _LONG_QUOTES if line.count(q) % 2), None)
            if header := _HEADER.match(line):
                names = _split(header[2])
                if header[1] == "[[":
                    parent = (*self._indexed(names[:-1], counts), names[-1])
                    counts[parent] = counts.get(parent, -1) + 1
                    current = [*parent, counts[parent]]
                else:
                    current = self._indexed(names, counts)
                here = list(current)
            elif key := _KEY.match(line):
                here = [*current, *_split(key[1])]
            else:
                continue
            depth = _common(here, path)
            # a key of the path, or a section that implies the path's last one: [a.b] implies a
            whole = depth in (len(here), len(path))
            if whole and depth and (best is None or depth > best[0]):
                best = (depth, number)
        return None if best is None else best[1]

    @staticmethod
    def _indexed(names: list[str], counts: dict[tuple[str | int, ...], int]) -> list[str | int]:
        """A section header below an array of tables belongs to the array's last element."""
        out: list[str | int] = []
        for name in names:
            out.append(name)
            if tuple(out) in counts:
                out.append(counts[tuple(out)])
        return out

    def error(
        self,
        problem: str,
        path: Sequence[str | int],
        *,
        found: Any = None,
        expected: str | None = None,
    ) -> InputError:
        """An `InputError` that names file, line and key path."""
        return InputError(
            problem,
            file=self.file,
            line=self.line_of(path),
            field=dotted(path),
            found=found,
            expected=expected,
        )

    def invalid(self, error: ValidationError, prefix: Sequence[str | int] = ()) -> InputError:
        """The first error of a validation of this document, or of its section at `prefix`."""
        first = first_invalid(error, self.data, prefix)
        return self.error(first.problem, first.path, found=first.found, expected=first.expected)

    def located(self, error: InputError) -> InputError:
        """An error from below with this file, and the line of its field, filled in."""
        line = None if error.field is None else self.line_of(parse_path(error.field))
        return error.at(file=self.file, line=line)


def dotted(path: Sequence[str | int]) -> str:
    """A key path for people.

    >>> dotted(("effects", 2, "shape"))
    'effects[2].shape'
    """
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def parse_path(text: str) -> tuple[str | int, ...]:
    """The reverse of `dotted`.

    >>> parse_path("effects[2].shape")
    ('effects', 2, 'shape')
    """
    parts: list[str | int] = []
    for name, index in re.findall(r"([^.\[\]]+)|\[(\d+)\]", text):
        parts.append(name if name else int(index))
    return tuple(parts)


def _split(dotted_key: str) -> list[str]:
    return [part.strip().strip("\"'") for part in dotted_key.split(".")]


def _common(here: Sequence[str | int], path: Sequence[str | int]) -> int:
    depth = 0
    for a, b in zip(here, path, strict=False):
        if a != b:
            break
        depth += 1
    return depth
