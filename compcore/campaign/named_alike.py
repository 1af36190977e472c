"""Set-ups whose names begin alike: people number the placings of one gauge or instrument."""

from __future__ import annotations

import re
from collections.abc import Iterable

_BEGINS = (r".", r"[^\W\d_A-Z]+|[A-Z]+", r"[^\W\d_]+")
"""The first letter; the letters until one is of another size; the letters."""


def named_alike(names: Iterable[str]) -> list[tuple[str, ...]]:
    """Groups of two set-ups and more whose names begin alike, the widest first."""
    names = list(names)
    found: dict[tuple[str, ...], None] = {}
    for begins in _BEGINS:
        groups: dict[str, list[str]] = {}
        for name in names:
            stem = re.match(begins, name)
            groups.setdefault(stem[0] if stem else "", []).append(name)
        found |= {tuple(group): None for group in groups.values() if len(group) > 1}
    return list(found)
