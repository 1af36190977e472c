"""The pages of docs/ about links: their text, and the sections that their examples configure."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[3] / "docs"


def page(name: str) -> str:
    """The text of docs/NAME.md."""
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def links_in(text: str) -> list[tuple[str, dict[str, Any]]]:
    """Name and section of every link in a page's examples."""
    return [
        (name, section)
        for example in re.findall(r"```toml\n(.*?)```", text, re.S)
        for name, section in tomllib.loads(example)["links"].items()
    ]
