"""Sentences for people that know what they were made of: a template and named values.

As text a `Sentence` is what a terminal prints. Who shows it in another language finds there the
template's translation and puts the same values in.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from string import ascii_lowercase


class Sentence(str):
    """A text with its template and its values, each of which may be one again."""

    template: str
    values: Mapping[str, str]

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


def joined(parts: Iterable[str], between: str = "; ") -> Sentence:
    """Several in a row.

    >>> joined([said("one"), said("two")]).template
    '{a}; {b}'
    """
    named = dict(zip(ascii_lowercase, parts, strict=False))
    return said(between.join(f"{{{name}}}" for name in named), **named)


def listed(names: Sequence[object]) -> str:
    """Names in a row, with a word between the last two.

    >>> listed(["X", "Y", "Z"])
    'X and Y and Z'
    """
    text = ""
    for name in reversed(names):
        text = said("{first} and {others}", first=name, others=text) if text else str(name)
    return text


def _made(text: str, template: str, values: Mapping[str, str]) -> Sentence:
    sentence = Sentence(text)
    sentence.template, sentence.values = template, values
    return sentence
