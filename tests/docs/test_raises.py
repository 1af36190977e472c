"""What a public function of the mathematics raises itself is said in its docstring."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = sorted(path.parent.name for path in (ROOT / "compcore").glob("*/__init__.py"))
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def public(body: list[ast.stmt]) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Public functions, and public methods of public classes."""
    for node in body:
        if isinstance(node, FUNCTIONS) and not node.name.startswith("_"):
            yield node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public(node.body)


def raises(function: ast.AST) -> bool:
    """Whether an error is made in the function itself, functions inside it apart."""
    inside = [
        n for n in ast.iter_child_nodes(function) if not isinstance(n, (*FUNCTIONS, ast.Lambda))
    ]
    return any(
        (isinstance(n, ast.Raise) and n.exc is not None and "NotImplemented" not in ast.dump(n.exc))
        or raises(n)
        for n in inside
    )


def silent(text: str) -> list[str]:
    """Public functions that raise and do not say so."""
    return [
        f"{f.lineno} {f.name}"
        for f in public(ast.parse(text).body)
        if raises(f) and not re.search(r"\braises?\b", ast.get_docstring(f) or "", re.IGNORECASE)
    ]


@pytest.mark.parametrize("room", ROOMS)
def test_what_is_raised_is_said(room: str) -> None:
    files = sorted((ROOT / "compcore" / room).rglob("*.py"))
    # of an effect, `check` refuses whatever its docstring does not list
    found = {
        str(f.relative_to(ROOT)): [
            s for s in silent(f.read_text("utf-8")) if s.split()[1] != "check"
        ]
        for f in files
    }
    assert {file: names for file, names in found.items() if names} == {}


@pytest.mark.parametrize(
    ("docstring", "count"),
    [('"""A length, mm."""', 1), ('"""A length, mm; raises `InputError`."""', 0), ("pass", 1)],
)
def test_a_silent_one_is_seen(docstring: str, count: int) -> None:
    body = f"    {docstring}\n    if x:\n        raise InputError('no')\n"
    assert len(silent(f"def length(x):\n{body}")) == count
    assert silent(f"def _length(x):\n{body}") == []
    assert silent("def length(x):\n    def inner():\n        raise InputError('no')\n") == []
