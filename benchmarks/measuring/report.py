"""Where benchmarks put their figures: sections of ``docs/performance.md``, one each."""

from __future__ import annotations

import os
import platform
import re
from pathlib import Path

from abbe.compcore.files.text.atomic import write_atomically

PAGE = Path(__file__).resolve().parents[2] / "docs" / "performance.md"

_OPENING = """# Performance

Measured by the scripts in `benchmarks/` (`make bench`), each side by side with what it is compared
to, in the same run on the same machine. Ratios travel to other machines; absolute times do not.
Every section is written by its own script.
"""


def write_section(name: str, markdown: str, page: Path = PAGE) -> None:
    """Put a benchmark's figures between its markers, in place or at the end of the page.

    Parameters
    ----------
    name
        The section's marker: ``<!-- name:begin -->`` … ``<!-- name:end -->``.
    markdown
        What stands between them, its own heading included.
    """
    text = page.read_text(encoding="utf-8") if page.exists() else _OPENING
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    section = f"{begin}\n{markdown.strip()}\n{end}"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if pattern.search(text):
        text = pattern.sub(lambda _: section, text)
    else:
        text = f"{text.rstrip()}\n\n{section}\n"
    write_atomically(page, text)


def machine() -> str:
    """The machine that measured, in one line."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = re.findall(r"^model name\s*:\s*(.+)$", info.read_text(), re.MULTILINE)
        cpu = names[0] if names else cpu
    return f"{cpu}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"
