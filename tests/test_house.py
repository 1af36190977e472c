"""Words of the house: a public class name stands for one thing in all three folders."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = ("compcore", "drivers", "daemon")

SAME_IDEA: dict[str, str] = {}
"""Names that may stand for several classes, and why it is one idea."""


def named_twice(root: Path) -> dict[str, list[str]]:
    """Public classes' names that more than one class has → their files and lines."""
    found = defaultdict(list)
    for folder in FOLDERS:
        for file in sorted((root / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    found[node.name].append(f"{file.relative_to(root)}:{node.lineno}")
    assert found
    return {name: places for name, places in found.items() if len(places) > 1}


def test_a_class_name_stands_for_one_thing():
    twice = named_twice(ROOT)
    assert {n: places for n, places in twice.items() if n not in SAME_IDEA} == {}
    assert set(SAME_IDEA) <= set(twice), "reasons for names that occur once"


@pytest.mark.parametrize("second", ["Axis", "_Axis"])
def test_a_second_class_of_a_name_is_found(tmp_path, second):
    (tmp_path / "compcore").mkdir()
    (tmp_path / "daemon" / "show").mkdir(parents=True)
    (tmp_path / "compcore" / "a.py").write_text("class Axis: ...\n")
    (tmp_path / "daemon" / "show" / "b.py").write_text(f"if True:\n    class {second}: ...\n")
    places = ["compcore/a.py:1", "daemon/show/b.py:2"]
    assert named_twice(tmp_path) == ({"Axis": places} if second == "Axis" else {})
