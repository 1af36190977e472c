"""The errors that Abbe tells its users; one line each, with what to mend.

::

    AbbeError                 anything that could not be done; exit status 1, no traceback
    ├── InputError            a file, a row, a field is wrong (also a ValueError)
    ├── NotContractionError   a correction cannot be inverted: the model is not a contraction
    └── FitError              the measurements cannot determine what was asked for
"""

from __future__ import annotations

from os import PathLike
from typing import Any

from abbe.compcore.sentences import Sentence, as_it_stands, joined, said


class AbbeError(Exception):
    """Base of Abbe's errors: what could not be done, in one message to a user."""

    @property
    def sentence(self) -> Sentence:
        """The message, with what it was made of."""
        first = self.args[0] if len(self.args) == 1 else None
        return as_it_stands(first if isinstance(first, str) else str(self))


class InputError(AbbeError, ValueError):
    """Bad input, named as precisely as it is known.

    Parameters
    ----------
    problem
        What is wrong, in a few words.
    file, line, field
        Where: path, line number (from 1), column or key.
    found, expected
        What stands there and what should.

    Examples
    --------
    >>> str(InputError("not a number", file="a.csv", line=7, field="value", found="abc",
    ...                expected="a number in µm"))
    "a.csv, line 7, field 'value': not a number: found 'abc', expected a number in µm"
    """

    def __init__(
        self,
        problem: str,
        *,
        file: str | PathLike[str] | None = None,
        line: int | None = None,
        field: str | None = None,
        found: Any = None,
        expected: str | None = None,
    ) -> None:
        self.problem = problem
        self.file = None if file is None else str(file)
        self.line = line
        self.field = field
        self.found = found
        self.expected = expected
        super().__init__(problem)

    def __str__(self) -> str:
        return str(self.sentence)

    @property
    def sentence(self) -> Sentence:
        """The message, with what it was made of: the place, what is wrong, what stands there."""
        where: list[str] = [_shortened(_printable(self.file))] if self.file else []
        if self.line is not None:
            where.append(said("line {number}", number=self.line))
        if self.field is not None:
            where.append(said("field {name}", name=repr(_shortened(self.field))))
        details: list[str] = []
        if self.found is not None:
            details.append(said("found {what}", what=_shortened(repr(self.found))))
        if self.expected is not None:
            details.append(said("expected {what}", what=as_it_stands(self.expected)))
        text = as_it_stands(self.problem)
        if where:
            text = said("{where}: {problem}", where=joined(where, ", "), problem=text)
        if details:
            text = said("{problem}: {details}", problem=text, details=joined(details, ", "))
        return text

    def of_file(self, file: str | PathLike[str] | None) -> InputError:
        """The same error in a file by another name: where it lies; None: the name that it has."""
        where = self.file if file is None else file
        return InputError(
            self.problem,
            file=where,
            line=self.line,
            field=self.field,
            found=self.found,
            expected=self.expected,
        )

    def at(
        self,
        *,
        file: str | PathLike[str] | None = None,
        line: int | None = None,
        field: str | None = None,
    ) -> InputError:
        """The same error with the place filled in where it was not yet known."""
        return InputError(
            self.problem,
            file=self.file if self.file is not None else file,
            line=self.line if self.line is not None else line,
            field=self.field if self.field is not None else field,
            found=self.found,
            expected=self.expected,
        )


_LONGEST = 300
"""Characters of what was found that a message shows."""


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}… ({len(text)} characters)"


def _printable(name: str) -> str:
    """A file's name in one line: control characters as Python writes them."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in name)


class NotContractionError(AbbeError):
    """The error field changes too fast with position for the correction to be inverted."""


class FitError(AbbeError):
    """The measurements cannot determine what was asked for."""


def require_type(value: object, kind: type, name: str) -> None:
    """Refuse an argument of a Python call that is another thing than it should be.

    Parameters
    ----------
    value
        What was given.
    kind
        What it should be.
    name
        The argument's name.

    Raises
    ------
    TypeError
        With what was given and expected, and where in it that stands.

    >>> require_type("model.toml", dict, "model")
    Traceback (most recent call last):
    TypeError: model: found str, expected dict
    """
    if isinstance(value, kind):
        return
    part = kind.__name__.lower()
    inside = isinstance(getattr(value, part, None), kind)
    raise TypeError(
        f"{name}: found {type(value).__name__}, expected {kind.__name__}"
        + (f" (its .{part} is one)" if inside else "")
    )
