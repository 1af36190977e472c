"""What a page of a command has packed into it, read without a browser."""

from __future__ import annotations

import json
import re
import zlib
from base64 import b64decode
from typing import Any


def packed(page: str, name: str) -> str:
    """What one of a page's data elements holds, as Python's zlib opens it."""
    found = re.findall(
        rf'<script type="text/plain" id="{name}" data-size="(\d+)">(.*?)</script>', page
    )
    ((size, text),) = found
    content = zlib.decompress(b64decode(text, validate=True), -zlib.MAX_WBITS)
    assert len(content) == int(size)
    return content.decode()


def figures_of(page: str) -> list[dict[str, Any]]:
    """The figures of a page, from top to bottom."""
    return list(json.loads(packed(page, "figures")).values())
