"""Limits of TOML text, checked before it is parsed: a small text can ask for all the memory."""

from __future__ import annotations

import re

from abbe.compcore.errors import InputError

MOST_BYTES = 64_000_000
"""Of a TOML file: the covariance of 3400 parameters."""
MOST_ITEMS = 500_000
"""Keys, elements of lists and parts of dotted keys."""
MOST_DEPTH = 40
"""Lists and tables within each other, and parts of one dotted key."""

_TOKEN = re.compile(
    r'"""(?:[^"\\]++|\\.|"(?!""))*+(?:""")?'
    r"|'''(?:[^']++|'(?!''))*+(?:''')?"
    r'|"(?:[^"\\\n]++|\\.)*+"?'
    r"|'[^'\n]*+'?"
    r"|\#[^\n]*+"
    r"|[][{}=,.\n]",
    re.DOTALL,
)


def check_bounds(text: str, file: str | None = None) -> None:
    """Refuse text that is nested too deeply or holds too many things.

    Raises
    ------
    InputError
        Names the line.
    """
    depth = dots = items = 0
    for token in _TOKEN.finditer(text):
        sign = token[0]
        if sign == "\n":
            dots = 0
            continue
        if len(sign) > 1:
            continue
        items += 1
        if sign in "[{":
            depth, dots = depth + 1, 0
        elif sign in "]}":
            depth, dots = max(depth - 1, 0), 0
        elif sign == ".":
            dots += 1
        else:
            dots = 0
        if max(depth, dots) > MOST_DEPTH or items > MOST_ITEMS:
            deep = items <= MOST_ITEMS
            raise InputError(
                "nested too deeply" if deep else "holds too much",
                file=file,
                line=text.count("\n", 0, token.start()) + 1,
                expected=f"at most {MOST_DEPTH} keys or brackets within each other"
                if deep
                else f"at most {MOST_ITEMS} keys, dots and elements of lists",
            )
