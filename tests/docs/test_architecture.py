"""docs/architecture.md and its picture are the house as it stands in the code."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools import house_picture as picture

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text("utf-8")
FLOORS = {
    "daemon": picture.DAEMON,
    "drivers": picture.DRIVERS,
    "compcore": (*picture.COMPCORE, (picture.FILES,)),
}
WALKS = re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:3]


def drawn(folder: str) -> set[str]:
    return {name for floor in FLOORS[folder] for name, _ in floor}


@pytest.mark.parametrize("folder", FLOORS)
def test_the_picture_has_every_room_and_no_other(folder: str) -> None:
    rooms = {path.parent.name for path in (ROOT / folder).glob("*/__init__.py")}
    assert drawn(folder) == rooms


def test_the_picture_is_up_to_date() -> None:
    """Otherwise run ``python -m tools.house_picture``."""
    assert picture.FILE.read_text("utf-8") == picture.svg()


def test_rooms_of_the_mathematics_import_downwards_only() -> None:
    floors = [{name for name, _ in floor} for floor in picture.COMPCORE]
    height = {name: -i for i, floor in enumerate(floors) for name in floor}
    height["files"] = 1
    found = list(imports())
    assert len(found) > 300
    assert [(a, b, file) for a, b, file in found if not height[b] < height[a]] == []


def imports() -> Iterator[tuple[str, str, str]]:
    """(room, room that it imports from, file) for all of compcore."""
    for file in sorted((ROOT / "compcore").rglob("*.py")):
        parts = file.relative_to(ROOT / "compcore").parts
        text = file.read_text("utf-8")
        for module in re.findall(r"^\s*from abbe\.compcore\.(\w+)", text, re.MULTILINE):
            if module in drawn("compcore") and module != parts[0]:
                # a file beside the rooms stands below them all
                yield parts[0], module, str(file)


@pytest.mark.parametrize(
    ("walk", "discs"), [(WALKS[0], picture.COUNT), (WALKS[1], picture.ROW)], ids=["count", "row"]
)
def test_each_step_of_a_walk_names_its_files_and_has_its_disc(
    walk: str, discs: dict[str, str]
) -> None:
    steps = re.findall(r"^\| (\d+) \|.*\| (.*) \|$", walk, re.MULTILINE)
    assert [int(number) for number, _ in steps] == list(range(1, len(steps) + 1))
    shown = {step: room for room, numbers in discs.items() for step in numbers.split()}
    assert set(shown) == {number for number, _ in steps}
    for number, cell in steps:
        files = re.findall(r"`([\w/]+\.py)`", cell)
        assert files, number
        for file in files:
            assert (ROOT / file).is_file(), file
        rooms = {part for file in files for part in file.split("/")[1:-1]}
        assert shown[number] in rooms, f"step {number} is drawn in {shown[number]}"
