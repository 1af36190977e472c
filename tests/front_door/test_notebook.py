"""examples/notebook.ipynb runs, and its outputs are those of today's Abbe."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import nbformat
import pytest

from tools.notebook import FILE, executed

pytestmark = [pytest.mark.integration, pytest.mark.timeout(400)]


def outputs(book: Any) -> Iterator[tuple[int, str, str]]:
    """(cell, MIME type, words) of every output; figures and tables by their type only."""
    for i, cell in enumerate(book.cells):
        for output in cell.get("outputs", ()):
            if output["output_type"] == "stream":
                yield i, output["name"], words(output["text"])
            for kind, content in output.get("data", {}).items():
                yield i, kind, words(content) if kind == "text/plain" else ""


def words(text: str) -> str:
    """Without numbers, whose last digits depend on the processor."""
    return re.sub(r"[-+]?\d[\d.e^-]*", "#", text)


def test_it_runs_and_says_what_it_said() -> None:
    kept = sorted(outputs(nbformat.read(FILE, as_version=4)))
    # otherwise run `python -m tools.notebook`
    assert sorted(outputs(executed())) == kept
    kinds = [kind for _, kind, _ in kept]
    assert kinds.count("application/vnd.plotly.v1+json") == 3
    assert kinds.count("text/html") >= 2
    assert "stderr" not in kinds


def test_it_is_small() -> None:
    assert FILE.stat().st_size < 200_000
