"""docs/sources.md: every module, command and test that a row names exists; no row lacks one."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest
import typer

from abbe.daemon.application import app

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "sources.md").read_text("utf-8")
HEAD = "method | in Abbe | proved by | figure |"
COMMANDS = set(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


def rows(page: str) -> list[list[str]]:
    """Cells of the rows of tables with the page's head: place, method, where, test, figure."""
    found, inside = [], False
    for line in page.splitlines():
        if line.startswith("|"):
            inside = inside or line.endswith(HEAD)
            cells = [cell.strip() for cell in line.strip("|").split(" | ")]
            if inside and not line.endswith(HEAD) and set(line) - set("|- "):
                found.append(cells)
        else:
            inside = False
    return found


ROWS = rows(PAGE)


@cache
def functions_of(file: Path) -> frozenset[str]:
    """Names of a file's functions."""
    nodes = ast.walk(ast.parse(file.read_text("utf-8")))
    return frozenset(n.name for n in nodes if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef))


def wrong(row: list[str], root: Path = ROOT) -> list[str]:
    """What a row names that is not there."""
    if len(row) != 5:
        return [f"{len(row)} cells"]
    _, _, where, proof, figure = row
    found = []
    named = re.findall(r"`([^`]+)`", where)
    for name in named:
        if name.startswith("abbe "):
            found += [name] if name.removeprefix("abbe ") not in COMMANDS else []
        elif not (root / name).is_file():
            found.append(name)
    proofs = re.findall(r"`([^`]+)::(\w+)`", proof)
    for file, test in proofs:
        path = root / file
        if not (path.is_file() and test.startswith("test_") and test in functions_of(path)):
            found.append(f"{file}::{test}")
    found += [what for what, there in (("where", named), ("test", proofs)) if not there]
    return found + ([] if figure else ["figure"])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[1][:50])
def test_what_a_row_names_is_there(row: list[str]) -> None:
    assert wrong(row) == []


def test_there_are_all_the_rows() -> None:
    assert len(ROWS) > 60
    assert len({tuple(row[:2]) for row in ROWS}) == len(ROWS), "a method stands twice"
    assert all(f"| {word} |" not in PAGE for word in ("?", "TODO"))


@pytest.mark.parametrize(
    ("where", "proof", "missing"),
    [
        ("`compcore/none.py`", "`tests/docs/test_sources.py::test_there_are_all_the_rows`", 1),
        ("`abbe none`", "`tests/docs/test_sources.py::test_there_are_all_the_rows`", 1),
        ("`abbe fit`", "`tests/docs/test_sources.py::test_none`", 1),
        ("`abbe fit`", "`tests/docs/test_sources.py::functions_of`", 1),
        ("`abbe fit`", "by eye", 1),
        ("somewhere", "`tests/docs/test_sources.py::test_there_are_all_the_rows`", 1),
        ("`abbe fit`", "`tests/docs/test_sources.py::test_there_are_all_the_rows`", 0),
    ],
)
def test_what_is_not_there_is_seen(where: str, proof: str, missing: int) -> None:
    (row,) = rows(
        f"| clause | {HEAD}\n| --- | --- | --- | --- | --- |\n| 1 | a | {where} | {proof} | 0 |"
    )
    assert len(wrong(row)) == missing
