"""Sentences for people that know what they were made of: a template and named values.

As text a `Sentence` is what a terminal prints. Who shows it in another language finds there the
template's translation and puts the same values in.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from string import ascii_lowercase
from typing import Any


class Sentence(str):
    """A text with its template and its values, each of which may be one again."""

    template: str
    values: Mapping[str, str]

    def padded(self, width: int) -> Sentence:
        """The same in a column that is so wide."""
        return _made(self.ljust(width), self.template, self.values)

    def rewritten(self, how: Callable[[str], str]) -> Sentence:
        """The same with its text and its values written otherwise; `how` keeps sentences."""
        return _made(how(str(self)), self.template, {k: how(v) for k, v in self.values.items()})

    def within(self) -> Sentence:
        """The same within a sentence: begun with a small letter where its first word is one."""
        small = self[:1].lower() + self[1:] if self[1:2].islower() else str(self)
        return _made(small, self.template, self.values)


def said(template: str, /, **values: object) -> Sentence:
    """Put values into a template.

    >>> said("{axis} is {size} off", axis="X", size=said("far"))
    'X is far off'
    """
    parts = {name: v if isinstance(v, str) else str(v) for name, v in values.items()}
    return _made(template.format(**parts), template, parts)


def as_it_stands(text: str) -> Sentence:
    """A text that is its own template; a sentence is given back.

    >>> as_it_stands("not a number").template
    'not a number'
    """
    return text if isinstance(text, Sentence) else _made(str(text), str(text), {})


def counted(count: int, one: str, several: str) -> Sentence:
    """A number of things: the words for one, or those for several with ``{n}`` in them.

    >>> counted(1, "1 target", "{n} targets"), counted(3, "1 target", "{n} targets")
    ('1 target', '3 targets')
    """
    return said(one) if count == 1 else said(several, n=count)


def joined(parts: Iterable[str], between: str = "; ") -> Sentence:
    """Several in a row.

    >>> joined([said("one"), said("two")]).template
    '{a}; {b}'
    """
    several = list(parts)
    if len(several) == 1:
        # wrapped once more it could not be told by its text from what it holds
        return as_it_stands(several[0])
    named = dict(zip(_names(), several, strict=False))
    return said(between.join(f"{{{name}}}" for name in named), **named)


def _names() -> Iterator[str]:
    """``a`` … ``z``, ``a1`` … without end."""
    for turn in itertools.count():
        yield from (f"{letter}{turn or ''}" for letter in ascii_lowercase)


def listed(names: Sequence[object]) -> str:
    """Names in a row, with a word between the last two.

    >>> listed(["X", "Y", "Z"])
    'X and Y and Z'
    """
    text = ""
    for name in reversed(names):
        text = said("{first} and {others}", first=name, others=text) if text else str(name)
    return text


def sentences_in(answer: Any) -> dict[str, list[Any]]:
    """Text → its template and its values, for every sentence of an answer and within those.

    What a page in another language has to know of an answer of texts, lists and mappings.
    """
    found: dict[str, list[Any]] = {}
    waiting = [answer]
    while waiting:
        part = waiting.pop()
        if isinstance(part, Sentence):
            if part not in found:
                found[str(part)] = [part.template, {k: str(v) for k, v in part.values.items()}]
                waiting += part.values.values()
        elif isinstance(part, Mapping):
            waiting += part.values()
        elif isinstance(part, list | tuple):
            waiting += part
    return found


_MOST = 50_000
"""Sentences that are remembered, the newest."""
_remembered: dict[str, Sentence] | None = None


@contextmanager
def remembered() -> Iterator[Mapping[str, Sentence]]:
    """While it lasts every sentence that is made is found by its text.

    For a process that hands its printed lines on to whoever shows them in another language.
    """
    global _remembered
    before, _remembered = _remembered, {}
    try:
        yield _remembered
    finally:
        _remembered = before


def _made(text: str, template: str, values: Mapping[str, str]) -> Sentence:
    sentence = Sentence(text)
    sentence.template, sentence.values = template, values
    if _remembered is not None:
        _remembered.pop(sentence, None)
        _remembered[sentence] = sentence
        if len(_remembered) > _MOST:
            del _remembered[next(iter(_remembered))]
    return sentence
