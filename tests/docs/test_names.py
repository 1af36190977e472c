"""One word, one meaning: no two classes of Abbe have the same name."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_class_has_a_name_of_its_own() -> None:
    places = defaultdict(set)
    for path in (p for h in ("compcore", "drivers", "daemon") for p in (ROOT / h).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places[node.name].add(str(path.relative_to(ROOT)))
    assert len(places) > 700, "the search finds no classes any more"
    assert {name: sorted(files) for name, files in places.items() if len(files) > 1} == {}
