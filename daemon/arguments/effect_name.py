"""Effects as people name them."""

from __future__ import annotations


def short(spec: str) -> str:
    """An effect's name for people: without a table's positions."""
    return " ".join(word for word in spec.split() if not word.startswith("positions="))
