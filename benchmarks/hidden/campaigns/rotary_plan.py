"""The plan of a campaign on a machine with rotary axes: lines, then balls at many angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine
from benchmarks.hidden.campaigns.plan import Planner, unit

F64 = NDArray[np.float64]

ROUNDS = 2
BALLS = 4
SWEEP = 8
"""Angles of the axis that turns fully, there and back, at each stand of the other."""


@dataclass(frozen=True)
class Layout:
    """A machine with rotary axes as its plans need it.

    Attributes
    ----------
    structure
        The structure code.
    travels
        Ends of the travels by axis: X, Y, Z in mm, then the rotary axes in rad.
    locations
        A point on the line of each rotary axis, mm.
    swept, stands
        The axis that turns fully; the other one, if there is one, with the angles (rad) at which
        it stands.
    centre, radius, height
        Where balls are placed: about this point (functional point in the workpiece's frame, mm),
        within this distance of it and of this height (least, greatest).
    tool
        Length of the probe, mm, negative.
    """

    structure: str
    travels: Mapping[str, tuple[float, float]]
    locations: Mapping[str, tuple[float, float, float]]
    swept: str
    stands: tuple[str, tuple[float, ...]] | None
    centre: tuple[float, float, float]
    radius: tuple[float, float]
    height: tuple[float, float]
    tool: float

    @property
    def axes(self) -> tuple[str, ...]:
        """X, Y, Z and the rotary axes."""
        return tuple(self.travels)

    def nominal(self) -> ExactMachine:
        """The machine without errors."""
        axes = {a: ExactAxis(location=p) for a, p in self.locations.items()}
        return ExactMachine(self.structure, axes)


def calibration(layout: Layout, rng: np.random.Generator) -> Planner:
    """Two rounds through a day: lines and diagonals, then each ball at many angles and back."""
    p = Planner(layout.axes, dict(layout.travels))
    balls = [_ball(layout, k / BALLS + 0.07, rng) for k in range(BALLS)]
    for cycle in range(ROUNDS):
        _lines(p, cycle)
        for k, ball in enumerate(balls):
            p.master()
            length = layout.tool - 60.0 * (k % 2)
            _probe(p, layout, f"ball{k}", ball, length, _sweeps(layout, cycle, 0.11 * k))
    return p


def check(layout: Layout, rng: np.random.Generator) -> Planner:
    """Other balls at angles in no order, other lines, another day: never fitted."""
    p = Planner(layout.axes, dict(layout.travels))
    for i in range(8):
        start, end = p.at(*rng.uniform(0.05, 0.95, 3)), p.at(*rng.uniform(0.05, 0.95, 3))
        p.line(f"line{i}", start, end, unit((end - start)[:3]), tool=int(rng.integers(3)))
    turning = layout.axes[3:]
    for k in range(8):
        ball = _ball(layout, float(rng.uniform()), rng)
        ends = np.array([layout.travels[a] for a in turning])
        poses = [rng.uniform(ends[:, 0], ends[:, 1]) for _ in range(14)]
        p.master()
        _probe(p, layout, f"ball{k}", ball, layout.tool - 30.0, poses)
    return p


def _lines(p: Planner, cycle: int) -> None:
    for a in range(3):
        for j, other in enumerate((0.3, 0.7)):
            parts = [[other] * 3, [other] * 3]
            parts[0][a], parts[1][a] = 0.02, 0.98
            p.line(f"c{cycle}_{'xyz'[a]}_pos{j}", p.at(*parts[0]), p.at(*parts[1]), np.eye(3)[a])
    for i, (one, two) in enumerate(((0, 1), (0, 2), (1, 2))):
        for down in (False, True):
            first, second = [0.5] * 3, [0.5] * 3
            first[one], second[one] = 0.04, 0.96
            first[two], second[two] = (0.96, 0.04) if down else (0.04, 0.96)
            start, end = p.at(*first), p.at(*second)
            name = f"c{cycle}_diag{2 * i + down}"
            p.line(name, start, end, unit((end - start)[:3]), tool=i % 3)


def _sweeps(layout: Layout, cycle: int, shift: float) -> list[F64]:
    """Angles of the rotary axes one after the other, shape (number of rotary axes,) each."""
    turning = layout.axes[3:]
    low, high = layout.travels[layout.swept]
    around = low + shift + (high - low) * (np.arange(SWEEP) + 0.1) / SWEEP
    around = around[around < high]
    other, angles = layout.stands or ("", (0.0,) * 4)
    order = angles[::-1] if cycle % 2 else angles
    found = []
    for i, stand in enumerate(order):
        for angle in around[::-1] if (i + cycle) % 2 else around:
            at = {layout.swept: angle, other: stand}
            found.append(np.array([at[a] for a in turning]))
    return found


def _ball(layout: Layout, part: float, rng: np.random.Generator) -> F64:
    """Where a ball lies, `part` of a turn about the centre, mm."""
    angle = 2.0 * np.pi * part
    radius, height = rng.uniform(*layout.radius), rng.uniform(*layout.height)
    around = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    return np.asarray(np.array(layout.centre) + around)


def _probe(
    p: Planner, layout: Layout, name: str, ball: F64, length: float, poses: Sequence[F64]
) -> None:
    """Meet a ball at every pose of the rotary axes, and read three directions there."""
    p.free[name] = ["frame"]
    nominal = layout.nominal()
    tool = np.array([0.0, 0.0, length])
    for pose in poses:
        state = dict.fromkeys("XYZ", 0.0) | dict(zip(layout.axes[3:], pose, strict=True))
        at_zero = nominal.point(state, tool)
        moves = [nominal.point(state | {a: 1.0}, tool) - at_zero for a in "XYZ"]
        place = np.append(np.linalg.solve(np.stack(moves, axis=1), ball - at_zero), pose)
        if (place < p.low - 1e-9).any() or (place > p.high + 1e-9).any():
            raise ValueError(f"{layout.structure}: out of travel at {place}")
        for k in range(3):
            p.point(name, place, np.eye(3)[k], tool)


LAYOUTS: dict[str, Layout] = {
    "trunnion": Layout(
        "w C' A' X' b Y Z t",
        {
            "X": (-300.0, 300.0),
            "Y": (-280.0, 280.0),
            "Z": (-100.0, 500.0),
            "A": (-1.7, 0.6),
            "C": (-np.pi, np.pi),
        },
        {"C": (10.0, -15.0, 0.0), "A": (0.0, 5.0, 40.0)},
        "C",
        ("A", (0.5, 0.2, -0.15, -0.6, -1.0, -1.5)),
        (10.0, -15.0, 0.0),
        (50.0, 150.0),
        (60.0, 160.0),
        -150.0,
    ),
    "turntable": Layout(
        "w C' b Y X Z t",
        {
            "X": (0.0, 700.0),
            "Y": (0.0, 900.0),
            "Z": (-360.0, 0.0),
            "C": (-np.pi, np.pi),
        },
        {"C": (350.0, 450.0, 0.0)},
        "C",
        None,
        (350.0, 450.0, -120.0),
        (80.0, 300.0),
        (-280.0, -80.0),
        -120.0,
    ),
    "head": Layout(
        "w b X Y Z C A t",
        {
            "X": (0.0, 1500.0),
            "Y": (0.0, 1000.0),
            "Z": (-600.0, 0.0),
            "C": (-np.pi, np.pi),
            "A": (-1.7, 1.7),
        },
        {"C": (0.0, 0.0, 0.0), "A": (0.0, 0.0, 30.0)},
        "C",
        ("A", (1.5, 0.9, 0.3, -0.3, -1.0, -1.6)),
        (750.0, 500.0, 0.0),
        (50.0, 100.0),
        (-480.0, -380.0),
        -160.0,
    ),
    "swivel": Layout(
        "w C' X' b Y Z B t",
        {
            "X": (-500.0, 500.0),
            "Y": (-400.0, 400.0),
            "Z": (-100.0, 600.0),
            "C": (-np.pi, np.pi),
            "B": (-1.7, 1.7),
        },
        {"C": (20.0, -10.0, 0.0), "B": (0.0, 0.0, 25.0)},
        "C",
        ("B", (1.4, 0.9, 0.4, 0.0, -0.7, -1.3)),
        (20.0, -10.0, 0.0),
        (60.0, 180.0),
        (40.0, 180.0),
        -150.0,
    ),
}
"""Machines with rotary axes by name: a five-axis mill with a tilting rotary table, a CMM with a
rotary table, a gantry with a fork head, a mill with a rotary table and a swivelling head."""
