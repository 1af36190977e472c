"""Plotly's script and the figures' numbers, packed into a page that asks nobody for anything.

Plotly.js is 4.8 MB, and a page's numbers some hundred kilobytes to two megabytes; deflated, as
base64, both together take 2 to 2.7 MB. The page opens them by a script of its own.
"""

from __future__ import annotations

import functools
import json
import zlib
from base64 import b64encode
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

_LEVEL = 6
"""Of compression: one more saves 2 kB of 1.5 MB."""


def packed_pictures(figures: Mapping[str, Any]) -> str:
    """The script elements that draw a page's figures, each in the element that has its name.

    Parameters
    ----------
    figures
        Name of each → its data and layout, of what JSON knows.
    """
    numbers = json.dumps(figures, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    own = files("abbe.daemon.report.pictures")
    scripts = [own.joinpath(name).read_text(encoding="utf-8") for name in ("inflate.js", "draw.js")]
    return "\n".join(
        (
            _element("figures", numbers.encode()),
            _packed_plotly(),
            *(f"<script>{script}</script>" for script in scripts),
        )
    )


def plotly_script() -> bytes:
    """Plotly.js as its package has it."""
    return files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()


@functools.cache
def _packed_plotly() -> str:
    script = plotly_script()
    notice = script[: script.index(b"*/") + 2].decode() if script.startswith(b"/*") else ""
    return f"<script>{notice}</script>{_element('plotly', script)}"


def _element(name: str, content: bytes) -> str:
    """What browsers take for data: base64 of raw deflate (RFC 1951), and its size when opened."""
    packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    text = b64encode(packer.compress(content) + packer.flush()).decode("ascii")
    return f'<script type="text/plain" id="{name}" data-size="{len(content)}">{text}</script>'
