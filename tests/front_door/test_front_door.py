"""`import abbe`: every name is there, from its room, and none is imported before it is used."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import abbe

SOURCE = Path(abbe.__file__)
IMPORTED = """
import json, sys
before = set(sys.modules)
import abbe
print(json.dumps(sorted(set(sys.modules) - before)))
"""


def test_importing_abbe_imports_nothing_else_of_weight() -> None:
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED], capture_output=True, text=True, check=True
    )
    modules = json.loads(done.stdout)
    assert "abbe" in modules
    assert [m for m in modules if m.startswith("abbe.")] == []
    heavy = {m.partition(".")[0] for m in modules} - {"abbe", "__future__"}
    # only modules of the interpreter's own
    assert heavy <= sys.stdlib_module_names


@pytest.mark.parametrize("name", abbe.__all__)
def test_name(name: str) -> None:
    found = getattr(abbe, name)
    assert found is vars(abbe)[name]
    assert found.__name__ == name
    assert name in dir(abbe)


def test_type_checkers_see_the_same_names_from_the_same_rooms() -> None:
    (block,) = (
        node
        for node in ast.parse(SOURCE.read_text(encoding="utf-8")).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    typed = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("abbe.")
        for alias in node.names
    }
    assert typed == abbe._HOME
    assert sorted(typed) == sorted(abbe.__all__) == abbe.__all__


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = abbe.fitt


def test_docstring_is_one_screen() -> None:
    lines = (abbe.__doc__ or "").splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 100
