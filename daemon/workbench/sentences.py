"""The sentences in an answer, with what each was made of: a page says them in its own language."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from abbe.compcore.sentences import Sentence


def sentences_in(answer: Any) -> dict[str, list[Any]]:
    """Text → its template and its values, for every sentence of an answer and within those."""
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
