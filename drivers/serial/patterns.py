r"""Patterns of the user's for lines of text, matched in bounded time.

The standard library's ``re`` may try every way in which a line does not fit: ``(\d+)+`` takes
seconds over thirty digits and an x, in which nothing else on this computer's event loop happens.
``regex`` finds most of that out at once, and gives up on the rest when told to. That costs it some
microseconds a line; so short lines are left to ``re`` where the pattern is simple enough to say
beforehand that no line of that length can take long.
"""

from __future__ import annotations

import math
import re

import regex

from abbe.drivers.link import LinkProtocolError

Match = re.Match[str] | regex.Match[str]

LIMIT = 5e-3
"""s of processor time for one line; a pattern that is any good takes microseconds."""
_LONGEST = 1000
"""Characters of a pattern: what is compiled in milliseconds, however it is nested."""
_TRIED_ON = ("1", "a", " ", "+1.5 ", "-0.1,", "\t", "=")
"""What a line that is tried on a new pattern consists of, again and again."""
_TRIED_LENGTH = 128
_TRIES = 3
"""A line that takes too long so often is the pattern's fault; `LIMIT` counts other threads too."""
_MOST_STEPS = 200_000
"""Ways to read a line that ``re`` may try: a millisecond or two."""
_LONGEST_LINE = 65_536
_ATOM = re.compile(r"\\[^1-9]|\[\^?\]?(?:\\.|[^\]\\])*\]")
"""An escape that is no reference, or a set of characters: one character of the line."""
_NOT_SIMPLE = re.compile(r"\\|\||\)[*+?{]|\((?=\?)(?!\?:|\?P<)")
"""References, alternatives, repeated groups, groups that look around or set flags."""


class SlowPatternError(LinkProtocolError):
    """A pattern took too long over a line."""


class LinePattern:
    """A regular expression for a whole text.

    Parameters
    ----------
    text
        The expression.

    Raises
    ------
    ValueError
        When it is none, is too long, or is so ambiguous that a line could hold everything up.
    """

    __slots__ = ("_compiled", "_plain", "_short", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        if len(text) > _LONGEST:
            raise ValueError(
                f"pattern {text[:40]!r}… has {len(text)} characters, expected at most {_LONGEST}"
            )
        try:
            self._compiled = regex.compile(text)
        except (regex.error, RecursionError, OverflowError, MemoryError) as error:
            raise ValueError(f"pattern {text!r} is no regular expression: {error}") from None
        self._short = simple_up_to(text)
        try:
            self._plain = re.compile(text)
        except re.error:
            self._short = -1

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of its fields."""
        return tuple(self._compiled.groupindex)

    def check(self) -> None:
        """Try it on lines that would take a bad one for ever.

        Raises
        ------
        ValueError
            When one does.
        """
        for piece in _TRIED_ON:
            line = (piece * _TRIED_LENGTH)[:_TRIED_LENGTH] + "\n\0"
            for left in reversed(range(_TRIES)):
                try:
                    self.fullmatch(line)
                    break
                except SlowPatternError:
                    if left:
                        continue
                    raise ValueError(
                        f"pattern {self.text!r} takes too long over a line of {line[:12]!r}…: a "
                        "repetition within a repetition, or alternatives that fit the same, can "
                        "be read in too many ways"
                    ) from None

    def fullmatch(self, text: str) -> Match | None:
        """The match with the whole text; None when it does not fit.

        Raises
        ------
        SlowPatternError
            When it cannot be said in `LIMIT`.
        """
        if len(text) <= self._short:
            return self._plain.fullmatch(text)
        try:
            return self._compiled.fullmatch(text, timeout=LIMIT)
        except TimeoutError:
            raise SlowPatternError(
                f"{text[:60]!r} came, and the pattern {self.text!r} takes more than "
                f"{LIMIT * 1e3:g} ms over it"
            ) from None


def simple_up_to(pattern: str) -> int:
    r"""Characters up to which no line can take `re` long; −1 when that is not known.

    Without alternatives, references and repeated groups, a line of n characters can be divided
    among k repetitions in (n + k over k) ways, and each optional character doubles them.

    >>> simple_up_to(r"X(?P<x>[-+.\d]+) Y(?P<y>[-+.\d]+)")
    630
    >>> simple_up_to(r"(\d+)+")
    -1
    """
    bare = _ATOM.sub("a", pattern)
    if _NOT_SIMPLE.search(bare):
        return -1
    bare = re.sub(r"\(\?(?::|P<\w+>)", "(", bare)
    bare = re.sub(r"([*+?}])[?+]", r"\1", bare)  # lazy and possessive ones
    repeated, optional = len(re.findall(r"[*+{]", bare)), bare.count("?")
    low, high = -1, _LONGEST_LINE
    while low < high:
        middle = (low + high + 1) // 2
        if math.comb(middle + repeated, repeated) << optional <= _MOST_STEPS:
            low = middle
        else:
            high = middle - 1
    return low


def checked(text: str) -> LinePattern:
    """A pattern from a configuration; raises ValueError when it cannot be used."""
    pattern = LinePattern(text)
    pattern.check()
    return pattern
