"""Texts as PostgreSQL takes them: it knows neither NUL nor halves of a surrogate pair."""

from __future__ import annotations

import json
from typing import Any

_INSTEAD = "\ufffd"


def plain(text: str) -> str:
    """The text, with a sign in the place of each character that cannot be stored."""
    return text.replace("\x00", _INSTEAD).encode("utf-8", "replace").decode("utf-8")


def plain_json(value: Any) -> str:
    """JSON of a value, all its texts so."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return plain(value)
    if isinstance(value, dict):
        return {plain(str(key)): _plain(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(held) for held in value]
    return value
