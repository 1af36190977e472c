"""What the imports say of the house: rooms, floors, arrows between them, and circles.

A *room* is a folder, or a file that lies loose, directly under ``compcore``, ``drivers`` or
``daemon``. An *arrow* goes from one room to another when a file of the first imports one of the
second, wherever the import stands: at the top, in a function or for type checking only. A room
stands one *floor* above the highest room that it imports; rooms that import one another in a circle
stand on one floor, and the arrows between them do not go down: they go *upwards*.

``python -m tools.house`` prints this for the working copy, ``python -m tools.house FOLDER`` for
another one.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

HOUSES = ("compcore", "drivers", "daemon")
_PACKAGE = "abbe."

Arrows = Mapping[str, Collection[str]]
"""Who → whom it imports."""


@dataclass(frozen=True)
class House:
    """The rooms of one folder.

    Attributes
    ----------
    name
        The folder.
    arrows
        Room → the rooms that it imports.
    floors
        Room → its floor, the ground being 1.
    circles
        Rooms that import one another, each circle in alphabetical order.
    upwards
        Arrows between rooms of one circle.
    """

    name: str
    arrows: Mapping[str, frozenset[str]]
    floors: Mapping[str, int]
    circles: tuple[tuple[str, ...], ...]
    upwards: tuple[tuple[str, str], ...]

    @property
    def count(self) -> int:
        """How many arrows there are."""
        return sum(len(below) for below in self.arrows.values())


def files(root: Path) -> dict[str, Path]:
    """The Python files of the three folders by the name under which they are imported."""
    found = {}
    for path in (path for house in HOUSES for path in sorted((root / house).rglob("*.py"))):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(root: Path) -> dict[str, frozenset[str]]:
    """File → the files of the three folders that it imports; a folder's own file is its name.

    Importing a file also runs the ``__init__`` of the folders above it; that is not counted.
    """
    known = files(root)
    return {name: frozenset(_imported(name, path, known)) for name, path in known.items()}


def _imported(name: str, path: Path, known: Collection[str]) -> Iterable[str]:
    folder = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        wanted: list[str] = []
        if isinstance(node, ast.Import):
            wanted = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = folder.split(".")[: 1 - node.level or None] if node.level else []
            base = ".".join([*start, *([node.module] if node.module else [])])
            wanted = [f"{base}.{alias.name}" for alias in node.names]
        for target in wanted:
            # the longest beginning that is a file: the rest is a name in it
            found = target.removeprefix(_PACKAGE)
            while found and found not in known:
                found = found.rpartition(".")[0]
            if found and found != name:
                yield found


def circles(arrows: Arrows) -> list[tuple[str, ...]]:
    """The groups of two or more that reach one another; each in alphabetical order."""
    return [tuple(sorted(group)) for group in _groups(arrows) if len(group) > 1]


def _groups(arrows: Arrows) -> list[list[str]]:
    """What reaches one another, in groups, those that are imported before those that import them.

    Tarjan's algorithm, without recursion.
    """
    order: dict[str, int] = {}
    lowest: dict[str, int] = {}
    path: list[str] = []
    on_path: set[str] = set()
    groups: list[list[str]] = []
    for start in sorted(arrows):
        if start in order:
            continue
        walk = [(start, iter(sorted(arrows[start])))]
        order[start] = lowest[start] = len(order)
        path.append(start)
        on_path.add(start)
        while walk:
            here, targets = walk[-1]
            target = next(targets, None)
            if target is None:
                walk.pop()
                if walk:
                    above = walk[-1][0]
                    lowest[above] = min(lowest[above], lowest[here])
                if lowest[here] == order[here]:
                    at = path.index(here)
                    groups.append(path[at:])
                    on_path.difference_update(path[at:])
                    del path[at:]
            elif target not in order:
                order[target] = lowest[target] = len(order)
                path.append(target)
                on_path.add(target)
                walk.append((target, iter(sorted(arrows[target]))))
            elif target in on_path:
                lowest[here] = min(lowest[here], order[target])
    return groups


def house(name: str, imported: Arrows) -> House:
    """The rooms of one folder.

    Parameters
    ----------
    name
        One of `HOUSES`.
    imported
        What `imports` gives.
    """
    within = partial(_room, house=name)
    rooms: dict[str, set[str]] = {}
    for file, targets in imported.items():
        room = within(file)
        if room is None:
            continue
        below = rooms.setdefault(room, set())
        below.update(
            r for r in (_room(target, name) for target in targets) if r not in (None, room)
        )
    floors: dict[str, int] = {}
    for group in _groups(rooms):
        below = {target for room in group for target in rooms[room]} - set(group)
        floors.update(dict.fromkeys(group, 1 + max((floors[room] for room in below), default=0)))
    rings = tuple(circles(rooms))
    return House(
        name,
        {room: frozenset(rooms[room]) for room in sorted(rooms)},
        floors,
        rings,
        tuple((a, b) for ring in rings for a in ring for b in ring if b in rooms[a]),
    )


def _room(file: str, house: str) -> str | None:
    """The room in which a file lies; None for another house's, and for the folder's own file."""
    parts = file.split(".")
    return parts[1] if parts[0] == house and len(parts) > 1 else None


def described(root: Path) -> str:
    """The three houses from the ground, and the circles of files, for people."""
    imported = imports(root)
    lines: list[str] = []
    for name in HOUSES:
        one = house(name, imported)
        top = max(one.floors.values(), default=0)
        lines.append(
            f"{name}: {len(one.arrows)} rooms on {top} floors, {one.count} arrows, "
            f"{len(one.upwards)} upwards, {len(one.circles)} circles of rooms"
        )
        for floor in range(1, top + 1):
            lines += [
                f"  {floor} {room} → {', '.join(sorted(one.arrows[room])) or 'nothing'}"
                for room in one.arrows
                if one.floors[room] == floor
            ]
        lines += [f"  circle: {', '.join(ring)}" for ring in one.circles]
        lines += [f"  upwards: {a} → {b}" for a, b in one.upwards]
    rings = circles(imported)
    lines.append(f"{len(rings)} circles of files")
    lines += [f"  {', '.join(ring)}" for ring in rings]
    return "\n".join(lines)


if __name__ == "__main__":
    print(described(Path(sys.argv[1] if len(sys.argv) > 1 else ".")))  # noqa: T201
