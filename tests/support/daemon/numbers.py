"""Numbers as people write them: what a command prints and a page says holds no ``4.66e+03``."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

_EXPONENT = re.compile(r"(?<![\w./=-])[+-]?\d+(?:\.\d+)?[eE][+-]?\d+(?!\w)")
_DIGITS = re.compile(r"(?<![\w.])[+−-]?(\d+(?:\.\d+)?) ± (\d+(?:\.\d+)?)(?![\w.·])")
_HIDDEN = re.compile(r"<(script|style|pre|code)\b.*?</\1>|<[^>]*>", re.DOTALL)


def unreadable(text: str) -> list[str]:
    """Numbers that nobody writes: powers by an ``e``, and values with other digits than their ±.

    >>> unreadable("5.2e-16 µm, 4664 ± 6.5e+02 s, 4664.21 ± 65 s; 4.66 ± 0.65, (4.1 ± 0.2)·10⁻⁹")
    ['5.2e-16', '6.5e+02', '4664.21 ± 65']
    """
    found = _EXPONENT.findall(text)
    for match in _DIGITS.finditer(text):
        value, sd = (number.partition(".")[2] for number in match.groups())
        if len(value) != len(sd):
            found.append(match[0])
    return found


def seen_of(page: Path) -> str:
    """What a person reads of a page."""
    return unescape(_HIDDEN.sub(" ", page.read_text("utf-8")))
