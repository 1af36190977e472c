"""Options that several commands have are written once; a command's range names its own option."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.daemon.arguments.ranges import ranges

ROOT = Path(__file__).parents[3]


def spelled_out() -> dict[str, list[str]]:
    """Each option or argument as it is written, and where."""
    found = defaultdict(list)
    for path in sorted((ROOT / "daemon").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Subscript)
                and isinstance(node.value, ast.Name)
                and node.value.id == "Annotated"
                and "typer." in ast.unparse(node)
            ):
                found[ast.unparse(node)].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    return found


def test_no_option_is_written_twice():
    found = spelled_out()
    assert len(found) > 60, "the search finds nothing any more"
    twice = {what: places for what, places in found.items() if len(places) > 1}
    assert not twice, "they belong into daemon/arguments"


@pytest.mark.parametrize("option", ["volume", "range", "travel"])
@pytest.mark.parametrize("text", ["X=0", "X=0,nan", "Q=0,1"])
def test_a_bad_range_names_the_option_that_gave_it(option, text):
    machine = Machine("m", Structure.parse("w b X t"), {"X": Axis("X", (0.0, 100.0))})
    with pytest.raises(InputError, match=option):
        ranges([text], machine, option)
