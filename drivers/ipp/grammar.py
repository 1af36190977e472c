"""The text of an I++ DME response: numbers, strings, names with arguments.

``X(99.93), Y(-.77)``, ``Tool.Alignment(0, 0.6, 0.8)``, ``"Speed", "Number"``, ``1.5, 2``. Numbers
are as strict as in the NIST test suite for I++ DME: at most 16 digits, at most three in the
exponent, no blank inside.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TypeAlias

from abbe.drivers.link import LinkProtocolError

_TOKEN = re.compile(
    r"""\s*(?:
        (?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)(?![\w.])
      | (?P<string>"[^"]*")
      | (?P<name>[A-Za-z]\w*(?:\.[A-Za-z]\w*)*)
      | (?P<sign>[(),])
    )\s*""",
    re.VERBOSE | re.ASCII,
)
_DIGITS = re.compile(r"\d")
_MOST_DIGITS = 16
_DEEPEST = 16
"""Brackets in brackets; a real response has three at most."""


@dataclass(frozen=True, slots=True)
class Named:
    """A name, with what stands in its brackets; None when it has no brackets.

    Attributes
    ----------
    name
        With its dots: ``Tool.GoToPar.Speed``.
    values
        Numbers, strings, further names.
    """

    name: str
    values: tuple[Value, ...] | None = None


Value: TypeAlias = float | str | Named


class _ResponseReader:
    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._kind: str | None = None
        self._token = ""
        self._step()

    def values(self, end: str | None, depth: int) -> tuple[Value, ...]:
        """A list up to a closing bracket, or to the end of the text."""
        if depth > _DEEPEST:
            raise self._error("brackets are nested too deep")
        found: list[Value] = []
        while not self._is(end):
            if found:
                if not self._is(","):
                    raise self._error("expected a comma")
                self._step()
            found.append(self._value(depth))
        self._step()
        return tuple(found)

    def _value(self, depth: int) -> Value:
        kind, token = self._kind, self._token
        if kind == "number":
            self._step()
            return float(token)
        if kind == "string":
            self._step()
            return token[1:-1]
        if kind == "name":
            self._step()
            if not self._is("("):
                return Named(token)
            self._step()
            return Named(token, self.values(")", depth + 1))
        if token == "(":
            # vectors stand in brackets without a name, e.g. AlignTool's answer
            self._step()
            return Named("", self.values(")", depth + 1))
        raise self._error("expected a number, a string or a name")

    def _is(self, sign: str | None) -> bool:
        if sign is None:
            return self._kind is None
        return self._kind == "sign" and self._token == sign

    def _step(self) -> None:
        if self._at == len(self._text):
            self._kind, self._token = None, ""
            return
        found = _TOKEN.match(self._text, self._at)
        if found is None or found.lastgroup is None:
            raise self._error("not understood")
        self._kind, self._token = found.lastgroup, found[found.lastgroup]
        if self._kind == "number":
            mantissa = re.split("[eE]", self._token)[0]
            if len(_DIGITS.findall(mantissa)) > _MOST_DIGITS or abs(float(self._token)) > 1e300:
                raise self._error("a number too long or too large")
        self._at = found.end()

    def _error(self, what: str) -> LinkProtocolError:
        return LinkProtocolError(f"{what} at character {self._at + 1} of {self._text[:120]!r}")


def parse(text: str) -> tuple[Value, ...]:
    """The values in a response's text.

    >>> parse('X(1.5), Tool.Name("Probe1")')
    (Named(name='X', values=(1.5,)), Named(name='Tool.Name', values=('Probe1',)))

    Raises
    ------
    LinkProtocolError
        When it does not follow the grammar; says where.
    """
    stripped = text.strip()
    if not stripped:
        return ()
    return _ResponseReader(stripped).values(None, 0)


def by_name(values: tuple[Value, ...], wrapper: str) -> dict[str, tuple[Value, ...]]:
    """Name → what stands in its brackets.

    Parameters
    ----------
    values
        Of one response, or of several lines of data together.
    wrapper
        Method whose name some servers put around the whole: ``Get(X(1), Y(2))``.

    Raises
    ------
    LinkProtocolError
        When a name comes twice, or something is not of the form ``Name(…)``.
    """
    if len(values) == 1:
        (only,) = values
        if isinstance(only, Named) and only.name == wrapper and only.values is not None:
            values = only.values
    found: dict[str, tuple[Value, ...]] = {}
    for value in values:
        if not isinstance(value, Named) or value.values is None:
            raise LinkProtocolError(f"found {shown(value)}, expected a name with brackets")
        if value.name in found:
            raise LinkProtocolError(f"{value.name} comes twice in an answer")
        found[value.name] = value.values
    return found


def shown(value: Value) -> str:
    """A value as it was written, more or less, for people.

    >>> shown(Named("X", (1.5, "a")))
    'X(1.5, "a")'
    """
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, str):
        return f'"{value}"'
    if value.values is None:
        return value.name
    return f"{value.name}({', '.join(map(shown, value.values))})"
