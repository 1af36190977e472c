"""The plan of a campaign: which lines, with which tool, when; master points between."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@dataclass
class Rows:
    """Rows of a campaign as they are planned, one list entry each."""

    time: list[float] = field(default_factory=list)
    setup: list[str] = field(default_factory=list)
    kind: list[str] = field(default_factory=list)
    position: list[F64] = field(default_factory=list)
    direction: list[F64] = field(default_factory=list)
    tool: list[F64] = field(default_factory=list)
    u: list[F64] = field(default_factory=list)


TOOLS = ((0.0, 0.0, -120.0), (60.0, 0.0, -180.0), (0.0, -80.0, -150.0))


class Planner:
    """Writes down line after line, with a visit to the master point before each.

    With `dense` above 1 lines have so many times the points in the same time.
    """

    def __init__(
        self, axes: tuple[str, ...], travels: dict[str, tuple[float, float]], dense: int = 1
    ) -> None:
        self.dense = dense
        self.axes = axes
        self.low = np.array([travels[a][0] for a in axes])
        self.high = np.array([travels[a][1] for a in axes])
        self.rows = Rows()
        self.free: dict[str, list[str]] = {}
        self.clock = 900.0
        self._direction = np.zeros(len(axes))

    def at(self, *parts: float) -> F64:
        """A position by parts (0 … 1) of the three linear travels; rotary axes stand at 0."""
        place = np.zeros(len(self.axes))
        place[:3] = self.low[:3] + np.array(parts) * (self.high[:3] - self.low[:3])
        return place

    def _row(self, setup: str, kind: str, place: F64, tool: F64, u: F64, step: float) -> None:
        if self.rows.position:
            moved = np.sign(np.round(place - self.rows.position[-1], 9))
            self._direction = np.where(moved == 0, self._direction, moved)
        r = self.rows
        r.time.append(self.clock)
        r.setup.append(setup)
        r.kind.append(kind)
        r.position.append(place)
        r.direction.append(self._direction.copy())
        r.tool.append(tool)
        r.u.append(u)
        self.clock += step

    def master(self) -> None:
        """Visit the master point, always approached from below."""
        middle = self.at(0.5, 0.5, 0.5)
        self._direction = np.ones(len(self.axes))
        for k in range(3):
            u = np.eye(3)[k]
            name = f"master_{'xyz'[k]}"
            self.free[name] = ["zero"]
            self._row(name, "displacement", middle, np.array(TOOLS[0]), u, 19.4)
            self.rows.direction[-1] = np.ones(len(self.axes))
        self._direction = np.ones(len(self.axes))

    def point(self, name: str, place: F64, u: F64, tool: F64) -> None:
        """One displacement of a set-up that leaves its zero unknown, unless it says otherwise."""
        self.free.setdefault(name, ["zero"])
        self._row(name, "displacement", place, tool, u, 11.8)

    def line(
        self,
        name: str,
        start: F64,
        end: F64,
        u: F64,
        *,
        kind: str = "displacement",
        tool: int = 0,
        free: tuple[str, ...] = ("zero",),
        points: int = 13,
    ) -> None:
        """A line there and back after a visit to the master point."""
        self.master()
        self.free[name] = list(free)
        parts = np.linspace(0.0, 1.0, points * self.dense)
        for p in [*parts, *parts[::-1]]:
            place = start + p * (end - start)
            self._row(name, kind, place, np.array(TOOLS[tool]), u, 11.8 / self.dense)
        self.clock += 25.0


def unit(vector: F64) -> F64:
    """The vector at length 1."""
    return np.asarray(vector / np.linalg.norm(vector))


def calibration(
    axes: tuple[str, ...],
    travels: dict[str, tuple[float, float]],
    between: Callable[[Planner], None] = lambda _: None,
    dense: int = 1,
) -> Planner:
    """Three rounds through a day: every axis's lines and angles, then diagonals, other tools.

    `between`: what else is measured before each round and after the last; `dense`: see `Planner`.
    """
    p = Planner(axes, travels, dense)
    for cycle in range(3):
        between(p)
        for a in range(3):
            letter = "xyz"[a]
            along = np.eye(3)[a]
            for j, (others, tool) in enumerate(
                (((0.5, 0.5), 0), ((0.15, 0.15), 1), ((0.85, 0.8), 2))
            ):
                if cycle and j == 2:
                    continue
                ends = [_with(p, a, e, others) for e in (0.02, 0.98)]
                p.line(f"c{cycle}_{letter}_pos{j}", *ends, along, tool=tool)
            for b in range(3):
                if b == a:
                    continue
                ends = [_with(p, a, e, (0.45, 0.45)) for e in (0.02, 0.98)]
                name = f"c{cycle}_{letter}_str{'xyz'[b]}"
                p.line(name, *ends, np.eye(3)[b], free=("zero", "slope"))
            if cycle == 0:
                for b in range(3):
                    ends = [_with(p, a, e, (0.5, 0.5)) for e in (0.02, 0.98)]
                    name = f"c{cycle}_{letter}_rot{'xyz'[b]}"
                    p.line(name, *ends, np.eye(3)[b], kind="rotation")
        _diagonals(p, cycle)
    between(p)
    return p


def _with(p: Planner, axis: int, part: float, others: tuple[float, float]) -> F64:
    parts = [0.0, 0.0, 0.0]
    parts[axis] = part
    for k, value in zip([i for i in range(3) if i != axis], others, strict=True):
        parts[k] = value
    return p.at(*parts)


def _diagonals(p: Planner, cycle: int) -> None:
    corners = [
        ((0.04, 0.04, 0.5), (0.96, 0.96, 0.5)),
        ((0.04, 0.96, 0.5), (0.96, 0.04, 0.5)),
        ((0.04, 0.5, 0.04), (0.96, 0.5, 0.96)),
        ((0.04, 0.5, 0.96), (0.96, 0.5, 0.04)),
        ((0.5, 0.04, 0.04), (0.5, 0.96, 0.96)),
        ((0.5, 0.04, 0.96), (0.5, 0.96, 0.04)),
        ((0.04, 0.04, 0.04), (0.96, 0.96, 0.96)),
        ((0.96, 0.04, 0.04), (0.04, 0.96, 0.96)),
        ((0.04, 0.96, 0.04), (0.96, 0.04, 0.96)),
        ((0.04, 0.04, 0.96), (0.96, 0.96, 0.04)),
    ]
    for i, (a, b) in enumerate(corners):
        if cycle == 1 and i % 2:
            continue
        start, end = p.at(*a), p.at(*b)
        p.line(f"c{cycle}_diag{i}", start, end, unit(end - start), tool=i % 3)


def check(
    rng: np.random.Generator, axes: tuple[str, ...], travels: dict[str, tuple[float, float]]
) -> Planner:
    """Other lines, other tools, another day: a campaign that is never fitted."""
    p = Planner(axes, travels)
    for i in range(36):
        start, end = p.at(*rng.uniform(0.05, 0.95, 3)), p.at(*rng.uniform(0.05, 0.95, 3))
        if np.linalg.norm(end - start) < 150.0:
            end = p.at(0.95, 0.95, 0.95)
        p.line(f"line{i}", start, end, unit(end - start), tool=int(rng.integers(3)), points=14)
    return p
