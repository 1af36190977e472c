"""Placings of instruments on the simulated bridge: lines, directions, probes, uncertainties."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.machine import AXES, TOOL, TRAVELS

Array: TypeAlias = NDArray[np.float64]

STEP: Final = {"X": 50.0, "Y": 50.0, "Z": 20.0}
"""Distance between measured positions, mm."""

LASER: Final = 0.36
"""Displacement's standard uncertainty, µm: repeatability 0.3 and the laser's 0.2."""
STRAIGHT: Final = 0.42
"""Straightness's, µm: repeatability 0.3 and the optics' 0.3."""
LEVEL: Final = 0.5
"""Of levels and autocollimators, µrad."""
PLATE: Final = 1.1
"""Z's roll against a surface plate, µrad: straightness twice, 400 mm apart."""

UNIT: Final = {"X": np.eye(3)[0], "Y": np.eye(3)[1], "Z": np.eye(3)[2]}
MIDDLE: Final = np.array([350.0, 450.0, -180.0])
ELSEWHERE: Final = MIDDLE + np.array([150.0, -200.0, 90.0])
PROBES: Final = (TOOL, (0.0, 0.0, -60.0), (120.0, 0.0, -100.0), (0.0, -120.0, -100.0))


@dataclass(frozen=True)
class InstrumentPlacing:
    """One placing of an instrument and what is read with it.

    Attributes
    ----------
    name
        The set-up's name.
    kind
        What is measured.
    positions
        Indicated positions in the order of measuring, mm, shape (n, 3).
    u
        Unit vector of the measured component.
    sd
        Standard uncertainty, µm or µrad.
    free
        What the placing leaves unknown.
    tools
        Probe offsets, mm, shape (3,) or (n, 3).
    """

    name: str
    kind: Literal["displacement", "rotation"]
    positions: Array
    u: Array
    sd: float
    free: tuple[str, ...] = ("zero",)
    tools: Array | tuple[float, float, float] = TOOL


def fit_sessions() -> list[tuple[float, list[InstrumentPlacing]]]:
    """What is measured for a fit at which ambient temperature (°C)."""
    return [
        (20.0, [*_frame(), *_geometry(), *_diagonals()]),
        *((t, [*_scales(f"{t:.1f}"), *_body(f"{t:.1f}", 1)]) for t in (18.8, 19.4, 20.7)),
        (21.3, [*_scales("21.3"), *_body("21.3", 2), *_angles("again", ELSEWHERE)]),
    ]


def _frame() -> Iterator[InstrumentPlacing]:
    """The workpiece's frame: what defines it is read absolutely."""
    home = np.zeros((5, 3))
    for number, probe in enumerate(PROBES):
        for axis in AXES:
            name = f"datum_{number}_{axis.lower()}"
            yield InstrumentPlacing(name, "displacement", home, UNIT[axis], LASER, (), probe)
    for axis, across in (("Y", "X"), ("Y", "Z"), ("X", "Z")):
        name = f"edge_{axis.lower()}_{across.lower()}"
        along = _sweep(axis, np.zeros(3))
        yield InstrumentPlacing(name, "displacement", along, UNIT[across], STRAIGHT, ())


def _geometry() -> Iterator[InstrumentPlacing]:
    """Displacement, straightness and angles of every axis along two lines each."""
    others = {"X": (0.0, 300.0, 120.0), "Y": (250.0, 0.0, -130.0), "Z": (-230.0, 280.0, 0.0)}
    probes = {"X": PROBES[3], "Y": PROBES[2], "Z": PROBES[1]}
    for axis in AXES:
        lines = ((MIDDLE, TOOL), (MIDDLE + np.array(others[axis]), probes[axis]))
        for number, (through, probe) in enumerate(lines, start=1):
            along, own = _sweep(axis, through), axis.lower()
            name = f"{own}_pos_{number}"
            yield InstrumentPlacing(name, "displacement", along, UNIT[axis], LASER, tools=probe)
            for across in AXES:
                if across != axis:
                    yield InstrumentPlacing(
                        f"{own}_straight_{across.lower()}_{number}",
                        "displacement",
                        along,
                        UNIT[across],
                        STRAIGHT,
                        ("zero", "slope"),
                        probe,
                    )
    yield from _angles("first", MIDDLE)


def _angles(label: str, through: Array) -> Iterator[InstrumentPlacing]:
    """All nine angles, along lines through a place."""
    for axis in AXES:
        along = _sweep(axis, through)
        for about in AXES:
            sd = PLATE if axis == about == "Z" else LEVEL
            name = f"{axis.lower()}_rot_{about.lower()}_{label}"
            yield InstrumentPlacing(name, "rotation", along, UNIT[about], sd)


def _scales(label: str) -> Iterator[InstrumentPlacing]:
    """Displacement of every axis along its middle line."""
    label = label.replace(".", "_")
    for axis in AXES:
        along = _sweep(axis, MIDDLE)
        yield InstrumentPlacing(
            f"{axis.lower()}_pos_{label}", "displacement", along, UNIT[axis], LASER
        )


def _diagonals() -> Iterator[InstrumentPlacing]:
    """Both diagonals of two faces in each direction, and the four body diagonals."""
    low, high = (np.array([TRAVELS[a][i] for a in AXES]) for i in (0, 1))
    for fixed in range(3):
        one, other = (i for i in range(3) if i != fixed)
        for share in (0.25, 0.75):
            for sign in (1, -1):
                start, end = low.copy(), high.copy()
                start[fixed] = end[fixed] = low[fixed] + share * (high - low)[fixed]
                if sign < 0:
                    start[other], end[other] = end[other], start[other]
                name = f"diagonal_{AXES[one].lower()}{AXES[other].lower()}"
                name += f"_{'p' if sign > 0 else 'm'}{round(100 * share)}"
                yield _along_line(name, start, end, 15, TOOL)
    yield from _body("20_0", 4)


def _body(label: str, count: int) -> Iterator[InstrumentPlacing]:
    """The first so many body diagonals."""
    label = label.replace(".", "_")
    starts = ((0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0))
    for number, start in enumerate(starts[:count], start=1):
        end = (1 - start[0], 1 - start[1], 1 - start[2])
        yield _along_line(f"body_{number}_{label}", _corner(start), _corner(end), 15, TOOL)


def random_lines(rng: np.random.Generator) -> Iterator[InstrumentPlacing]:
    """50 lines of at least 300 mm along arbitrary directions, with other probes."""
    low, high = _corner((0, 0, 0)), _corner((1, 1, 1))
    number = 0
    while number < 50:
        start, end = rng.uniform(low, high), rng.uniform(low, high)
        if math.dist(start, end) < 300.0:
            continue
        number += 1
        probe = np.round(rng.uniform((-80.0, -80.0, -220.0), (80.0, 80.0, -60.0)))
        tool = (float(probe[0]), float(probe[1]), float(probe[2]))
        yield _along_line(f"line_{number:02d}", np.round(start, 1), np.round(end, 1), 13, tool)


def _corner(which: tuple[int, int, int]) -> Array:
    return np.array([TRAVELS[a][i] for a, i in zip(AXES, which, strict=True)])


def _along_line(
    name: str, start: Array, end: Array, points: int, tool: tuple[float, float, float]
) -> InstrumentPlacing:
    """Displacement along a straight line, there and back."""
    there = start + np.linspace(0.0, 1.0, points)[:, None] * (end - start)
    # As a controller would be given it: whole tenths of a µm.
    positions = np.round(np.concatenate([there, there[::-1]]), 4)
    u = (end - start) / math.dist(start, end)
    return InstrumentPlacing(name, "displacement", positions, u, LASER, tools=tool)


def _sweep(axis: str, through: Array) -> Array:
    """Positions along an axis's whole travel, there and back, the other axes as in `through`."""
    low, high = TRAVELS[axis]
    count = round((high - low) / STEP[axis]) + 1
    out = np.tile(through, (count, 1))
    out[:, AXES.index(axis)] = np.linspace(low, high, count)
    return np.concatenate([out, out[::-1]])
