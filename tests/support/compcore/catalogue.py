"""One row for each kind of effect: keys, parameters, and a reference that is not compcore's.

References are closed forms in the rows' own numbers (`World`), written from the catalogue and from
textbooks; lags come from SciPy's simulation of a linear system.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import lsim

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure

SIGNALS = {
    s.name: s
    for s in (
        Signal("T_x", role="scale", axis="X"),
        Signal("T_front", role="structure", axis="Z"),
        Signal("T_rear", role="structure", axis="Z"),
        Signal("T_spindle", role="spindle"),
        Signal("T_screw", role="screw", axis="Y"),
        Signal("T_part", role="workpiece"),
        Signal("T_air", role="air"),
        Signal("p_air", unit="hPa", role="air"),
        Signal("h_air", unit="%", role="air"),
        Signal("load", unit="kg", role="load"),
        Signal("speed", unit="rpm", role="speed"),
        Signal("feed", unit="mm/min", role="speed", axis="X"),
    )
}
MILL = Machine(
    "mill",
    Structure.parse("w X' b Y Z t"),
    {
        "X": Axis("X", (0.0, 800.0)),
        "Y": Axis("Y", (-250.0, 250.0)),
        "Z": Axis("Z", (-450.0, 0.0)),
    },
    SIGNALS,
    reference_temperature=20.0,
)
FIVE_AXIS = Machine(
    "five axes",
    Structure.parse("w C' A' b Y X Z (C1) t"),
    {
        "X": Axis("X", (0.0, 500.0)),
        "Y": Axis("Y", (0.0, 400.0)),
        "Z": Axis("Z", (-350.0, 0.0)),
        "A": Axis("A", (-math.pi / 2, math.pi / 6), location=(0.0, 200.0, -300.0)),
        "C": Axis("C", (-2 * math.pi, 2 * math.pi), location=(250.0, 200.0, 0.0)),
    },
    SIGNALS,
)
HEAD = Machine(
    "fork head",
    Structure.parse("w b X Y Z C B t"),
    {
        **{a: FIVE_AXIS.axes[a] for a in "XYZ"},
        "C": Axis("C", (-math.pi, math.pi), location=(0.0, 0.0, 250.0)),
        "B": Axis("B", (-math.pi / 2, math.pi / 2), location=(0.0, 0.0, 250.0)),
    },
    SIGNALS,
)
N = 240


@dataclass(frozen=True)
class World:
    """The same numbers as the conditions, by name: q, s, T, t, tool, u, and what was set up."""

    q: Mapping[str, np.ndarray]
    s: Mapping[str, np.ndarray]
    T: Mapping[str, np.ndarray]
    t: np.ndarray
    tool: np.ndarray
    u: np.ndarray
    setup: np.ndarray
    kind: np.ndarray
    base: np.ndarray
    distance: np.ndarray

    @property
    def one(self) -> np.ndarray:
        return np.ones(len(self.t))

    def lagged(self, name: str, tau: float) -> np.ndarray:
        """τ·y' = T − y, y(0) = T(0), input straight between samples: SciPy's lsim."""
        step = 60.0
        grid = np.arange(N) * step
        value = self.T[name][np.argsort(self.t)]
        _, y, _ = lsim(([1.0 / tau], [1.0, 1.0 / tau]), value - value[0], grid, interp=True)
        out = np.empty(N)
        out[np.argsort(self.t)] = y + value[0]
        return out


def world(machine: Machine, seed: int = 7) -> World:
    """Random rows within the travels, random set-ups of all kinds, one row a minute."""
    rng = np.random.default_rng(seed)
    q = {a.name: rng.uniform(*a.travel, N) for a in machine.axes.values()}
    s = {a: rng.choice([-1.0, 0.0, 1.0], N, p=[0.45, 0.1, 0.45]) for a in machine.axes}
    t = rng.permutation(N) * 60.0
    T = {}
    for signal in machine.signals.values():
        slow = rng.normal(size=4) @ np.sin(np.outer(np.arange(1, 5), t / 5000.0) + 1.0)
        middle, swing = {"hPa": (1000.0, 8.0), "%": (45.0, 9.0), "kg": (400.0, 150.0)}.get(
            signal.unit, (21.5, 1.2) if signal.temperature else (3000.0, 900.0)
        )
        T[signal.name] = middle + swing * slow
    u = rng.normal(size=(N, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    setup = rng.choice(["line", "level", "plate", "bar"], N)
    kind = np.array([{"level": 1, "bar": 2}.get(name, 0) for name in setup], dtype=np.int8)
    base = np.where(setup == "bar", rng.choice(["B1", "B2"], N), "")
    distance = np.where(setup == "bar", rng.uniform(300.0, 700.0, N), 0.0)
    tool = rng.uniform(-120.0, 120.0, (N, 3))
    return World(q, s, T, t, tool, u, setup, kind, base, distance)


def conditions(w: World) -> Conditions:
    return Conditions(
        positions=w.q,
        directions=w.s,
        tool=w.tool,
        time=w.t,
        signals=w.T,
        setup=w.setup,
        u=w.u,
        base=w.base,
        kind=w.kind,
        distance=w.distance,
    )


@dataclass(frozen=True)
class Row:
    """A kind, how it is asked for, values of its parameters, and what it must then do."""

    kind: str
    keys: Mapping[str, object]
    linear: Mapping[str, float]
    truth: Callable[[World], Mapping[str, np.ndarray]]
    nonlinear: Mapping[str, float] = field(default_factory=dict)
    machine: Machine = MILL
    spec: str = ""

    @property
    def label(self) -> str:
        return self.spec or self.kind


def _splines(x: np.ndarray, coefficients: list[float], low: float, high: float) -> np.ndarray:
    """Clamped uniform cubic B-splines by SciPy."""
    inner = len(coefficients) - 3
    knots = np.concatenate([[low] * 3, np.linspace(low, high, inner + 1), [high] * 3])
    return BSpline(knots, coefficients, 3)(np.clip(x, low, high))


def _since_first(w: World, values: np.ndarray) -> np.ndarray:
    out = np.empty_like(values)
    for name in np.unique(w.setup):
        rows = np.flatnonzero(w.setup == name)
        out[rows] = values[rows] - values[rows[np.argmin(w.t[rows])]]
    return out


def _edlen(w: World) -> np.ndarray:
    """Index of air by another formula than compcore's: Edlén, as NIST's toolbox states it.

    Within 2e-9 of Ciddor's near 20 °C.
    """
    t, p, h = w.T["T_air"], w.T["p_air"] * 100.0, w.T["h_air"]
    s = 0.6329912**-2
    standard = 1e-8 * (8342.54 + 2406147.0 / (130.0 - s) + 15998.0 / (38.9 - s))
    x = (1.0 + 1e-8 * (0.601 - 0.00972 * t) * p) / (1.0 + 0.003661 * t)
    dry = p * standard * x / 96095.43
    vapour = h / 100.0 * 611.21 * np.exp((18.678 - t / 234.5) * t / (257.14 + t))
    return 1.0 + dry - 1e-10 * 292.75 / (t + 273.15) * (3.7345 - 0.0401 * s) * vapour


def _along(w: World) -> np.ndarray:
    point = np.stack([w.q[a] for a in "XYZ"], axis=1) + w.tool
    moved = np.stack([_since_first(w, point[:, k]) for k in range(3)], axis=1)
    return np.einsum("ni,ni->n", moved, w.u) * (w.kind == 0)


def _path(w: World, name: str) -> np.ndarray:
    """Principal direction of a set-up's positions by the covariance's eigenvector."""
    rows = w.setup == name
    points = np.stack([w.q[a][rows] for a in "XYZ"], axis=1)
    centred = points - points.mean(axis=0)
    direction = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    along = np.zeros(N)
    along[rows] = centred @ direction
    return along / np.abs(along).max()


_HELD = (0.01, -0.02, 0.035)


def _hanging(w: World, pull: np.ndarray) -> dict[str, np.ndarray]:
    """An arm along X on the table C that A carries, pulled by a force fixed in the bed."""
    turns = np.empty((N, 3))
    for i, (a, c) in enumerate(zip(w.q["A"], w.q["C"], strict=True)):
        ca, sa = math.cos(a), math.sin(a)
        # the force as A's table sees it, and the arm there; the table turns the other way round
        seen = np.array([pull[0], ca * pull[1] - sa * pull[2], sa * pull[1] + ca * pull[2]])
        turns[i] = -np.cross([math.cos(c), -math.sin(c), 0.0], seen)
    return {f"E_{k}C": turns[:, i] for i, k in enumerate("ABC")}


def _weighing(w: World, joints: tuple[str, str], pull: np.ndarray) -> dict[str, np.ndarray]:
    """The inner joint under the spindle of a fork head, or under an arm along X on a table."""
    inner, outer = (w.q[j] for j in joints)
    if joints == ("C", "B"):
        way = 1.0
        part = [np.cos(inner) * np.sin(outer), np.sin(inner) * np.sin(outer), np.cos(outer)]
    else:
        # A' and C' turn the other way round
        way = -1.0
        part = [np.cos(outer), -np.cos(inner) * np.sin(outer), np.sin(inner) * np.sin(outer)]
    turns = way * np.cross(np.stack(part, axis=1), pull)
    return {f"E_{k}{joints[0]}": turns[:, i] for i, k in enumerate("ABC")}


def _lobes(w: World, lobes: complex, latitude: float) -> np.ndarray:
    """Three lobes about the tool, by the third power of a complex number: no angle is taken."""
    out = np.empty(N)
    for i, (tool, u) in enumerate(zip(w.tool, w.u, strict=True)):
        away = -tool / math.sqrt(tool @ tool)
        near = np.array([1.0, 0.0, 0.0] if abs(away[0]) < 0.9 else [0.0, 1.0, 0.0])
        first = near - (near @ away) * away
        first = first / math.sqrt(first @ first)
        across = complex(u @ first, u @ np.cross(away, first))
        out[i] = (lobes * across**3).real / abs(across) ** 2 + latitude * abs(across) ** 2
    return out


def _scaled(w: World, part: float | np.ndarray) -> np.ndarray:
    """A plate that is too large by a part, about the middle of its points."""
    rows = w.setup == "plate"
    point = np.stack([w.q[a] for a in "XYZ"], axis=1) + w.tool
    arm = point - point[rows].mean(axis=0)
    return np.where(rows, -part * (arm * w.u).sum(axis=1), 0.0)


def _frame(w: World) -> np.ndarray:
    """A plate moved by (0.1, −0.2, 0.05) mm and turned by a small vector about its middle."""
    rows = w.setup == "plate"
    point = np.stack([w.q[a] for a in "XYZ"], axis=1) + w.tool
    arm = point - point[rows].mean(axis=0)
    moved = np.array([0.1, -0.2, 0.05]) + np.cross([1e-5, -2e-5, 3e-5], arm)
    return np.where(rows, np.einsum("ni,ni->n", moved, w.u), 0.0)


def _bump(x: np.ndarray, centre: float, width: float) -> np.ndarray:
    """Triweight kernel: half of its height at centre ± width/2."""
    half = width / 2.0 / math.sqrt(1.0 - 0.5 ** (1.0 / 3.0))
    inside = np.abs(x - centre) < half
    return np.where(inside, (1.0 - ((x - centre) / half) ** 2) ** 3, 0.0)


def _risen(part):
    """From 0 to 1 over parts −½ to ½, the integral of a parabola that ends at both."""
    part = np.clip(part, -0.5, 0.5)
    return 0.5 + 1.5 * part - 2.0 * part**3


def _hat(x: np.ndarray, y: tuple[float, ...], nodes: tuple[float, ...]) -> np.ndarray:
    return np.interp(x, nodes, y)


VALUE = "measured value"
ROWS: tuple[Row, ...] = (
    Row(
        "positioning",
        {"axis": "X", "shape": "polynomial:2"},
        {"c0": 0.01, "c1": -0.02, "c2": 0.005},
        lambda w: {
            "E_XX": 0.01
            - 0.02 * (w.q["X"] / 400 - 1)
            + 0.005 * (1.5 * (w.q["X"] / 400 - 1) ** 2 - 0.5)
        },
    ),
    Row("scale", {"axis": "Z"}, {"k": 5e-5}, lambda w: {"E_ZZ": 5e-5 * w.q["Z"]}),
    Row(
        "straightness",
        {"axis": "Y", "direction": "Z", "shape": "spline:6"},
        {f"c{i}": c for i, c in enumerate((0.01, -0.02, 0.0, 0.015, 0.01, -0.01), start=1)},
        lambda w: {"E_ZY": _splines(w.q["Y"], [0.01, -0.02, 0.0, 0.015, 0.01, -0.01], -250, 250)},
    ),
    Row(
        "angular",
        {"axis": "Z", "about": "X", "shape": "table", "positions": "-450,-200,0"},
        {"v1": 2e-5, "v2": -4e-5, "v3": 1e-5},
        lambda w: {"E_AZ": _hat(w.q["Z"], (2e-5, -4e-5, 1e-5), (-450.0, -200.0, 0.0))},
    ),
    Row("squareness", {"axes": "Y,Z"}, {"angle": 8e-5}, lambda w: {"E_AY": 8e-5 * w.one}),
    Row(
        "squareness",
        {"axes": "X,Y"},
        {"angle": 8e-5},
        # on the workpiece side the axis's own move is not turned along: ω × X = ω·X in Y
        lambda w: {"E_CX": 8e-5 * w.one, "E_YX": -8e-5 * w.q["X"]},
        spec="squareness of a table",
    ),
    Row(
        "cyclic",
        {"axis": "X", "harmonics": 2},
        {"A1": 0.004, "B1": -0.003, "A2": 0.001, "B2": 0.002},
        lambda w: {
            "E_XX": 0.004 * np.cos(2 * np.pi * w.q["X"] / 23.7)
            - 0.003 * np.sin(2 * np.pi * w.q["X"] / 23.7)
            + 0.001 * np.cos(4 * np.pi * w.q["X"] / 23.7)
            + 0.002 * np.sin(4 * np.pi * w.q["X"] / 23.7)
        },
        nonlinear={"period": 23.7},
    ),
    Row(
        "cyclic",
        {"axis": "Y", "period": "10"},
        {"A1": 0.004, "B1": -0.003},
        lambda w: {
            "E_YY": np.real((0.004 + 0.003j) * np.exp(2j * np.pi * w.q["Y"] / 10.0)),
        },
        spec="cyclic of a given period",
    ),
    Row(
        "cyclic",
        {"axis": "C"},
        {"A1": 2e-5, "B1": -1e-5},
        lambda w: {"E_CC": np.real((2e-5 + 1e-5j) * np.exp(36j * w.q["C"]))},
        nonlinear={"period": 2.0 * math.pi / 36.0},
        machine=FIVE_AXIS,
        spec="cyclic of a worm",
    ),
    Row("backlash", {"axis": "Z"}, {"b": 0.012}, lambda w: {"E_ZZ": 0.006 * w.s["Z"]}),
    Row(
        "backlash",
        {"axis": "X", "shape": "polynomial:1"},
        {"c0": 0.012, "c1": 0.004},
        lambda w: {"E_XX": 0.5 * w.s["X"] * (0.012 + 0.004 * (w.q["X"] / 400 - 1))},
        spec="backlash along the axis",
    ),
    Row(
        "backlash",
        {"axis": "C"},
        {"b": 6e-5},
        lambda w: {"E_CC": 3e-5 * w.s["C"]},
        machine=FIVE_AXIS,
        spec="backlash of a worm",
    ),
    Row(
        "reversal_angle",
        {"axis": "Y", "about": "Z"},
        {"b": 3e-5},
        lambda w: {"E_CY": 1.5e-5 * w.s["Y"]},
    ),
    Row(
        "lateral_reversal",
        {"axis": "X", "direction": "Z"},
        {"b": 0.004},
        lambda w: {"E_ZX": 0.002 * w.s["X"]},
    ),
    Row(
        "lateral_reversal",
        {"axis": "Y", "direction": "X", "shape": "polynomial:1"},
        {"c0": 0.004, "c1": -0.006},
        lambda w: {"E_XY": 0.5 * w.s["Y"] * (0.004 - 0.006 * w.q["Y"] / 250.0)},
        spec="lateral_reversal, a squareness by direction",
    ),
    Row(
        "lateral_reversal",
        {"axis": "C", "direction": "X"},
        {"b": -0.006},
        lambda w: {"E_XC": -0.003 * w.s["C"]},
        machine=FIVE_AXIS,
        spec="lateral_reversal of a worm wheel",
    ),
    Row(
        "local_defect",
        {"axis": "X", "error": "E_ZX"},
        {"depth": -0.02},
        lambda w: {"E_ZX": -0.02 * _bump(w.q["X"], 310.0, 90.0)},
        nonlinear={"centre": 310.0, "width": 90.0},
    ),
    Row(
        "joint",
        {"axis": "X", "error": "E_XX", "over": 40.0},
        {"step": 0.005},
        lambda w: {"E_XX": 0.005 * _risen((w.q["X"] - 310.0) / 40.0)},
        nonlinear={"centre": 310.0},
    ),
    Row(
        "joint",
        {"error": "E_BX", "centre": 310.0, "over": 250.0},
        {"step": -2e-5},
        lambda w: {"E_BX": -2e-5 * _risen((w.q["X"] - 310.0) / 250.0)},
        spec="joint of two beds",
    ),
    Row(
        "rotary_location",
        {"axis": "C"},
        {"E_X0C": 0.02, "E_Y0C": -0.03, "E_A0C": 4e-5, "E_B0C": -5e-5, "E_C0C": 1e-4},
        lambda w: {
            "E_XC": 0.02 * w.one,
            "E_YC": -0.03 * w.one,
            "E_AC": 4e-5 * w.one,
            "E_BC": -5e-5 * w.one,
            "E_CC": 1e-4 * w.one,
        },
        machine=FIVE_AXIS,
    ),
    Row(
        "rotary_location",
        {"axis": "A"},
        {"E_Y0A": 0.02, "E_Z0A": -0.03, "E_B0A": 4e-5, "E_C0A": -5e-5, "E_A0A": 1e-4},
        lambda w: {
            "E_YA": 0.02 * w.one,
            "E_ZA": -0.03 * w.one,
            "E_BA": 4e-5 * w.one,
            "E_CA": -5e-5 * w.one,
            "E_AA": 1e-4 * w.one,
        },
        machine=FIVE_AXIS,
        spec="rotary_location of A",
    ),
    Row(
        "rotary_positioning",
        {"axis": "C", "harmonics": 3},
        {"A1": 1e-5, "B1": 2e-5, "A2": -3e-5, "B2": 4e-5, "A3": 5e-6, "B3": -6e-6},
        lambda w: {
            "E_CC": np.real(
                (1e-5 - 2e-5j) * np.exp(1j * w.q["C"])
                + (-3e-5 - 4e-5j) * np.exp(2j * w.q["C"])
                + (5e-6 + 6e-6j) * np.exp(3j * w.q["C"])
            )
        },
        machine=FIVE_AXIS,
    ),
    Row(
        "rotary_positioning",
        {"axis": "A", "shape": "table", "positions": "-90,0,30"},
        {"v1": 1e-5, "v2": 0.0, "v3": -3e-5},
        lambda w: {"E_AA": _hat(np.degrees(w.q["A"]), (1e-5, 0.0, -3e-5), (-90.0, 0.0, 30.0))},
        machine=FIVE_AXIS,
        spec="rotary_positioning by a table in degrees",
    ),
    Row(
        "rotary_radial",
        {"axis": "C", "direction": "Y"},
        {"A1": 0.003, "B1": 0.001, "A2": -0.002, "B2": 0.0005},
        lambda w: {
            "E_YC": 0.003 * np.cos(w.q["C"])
            + 0.001 * np.sin(w.q["C"])
            - 0.002 * np.cos(2 * w.q["C"])
            + 0.0005 * np.sin(2 * w.q["C"])
        },
        machine=FIVE_AXIS,
    ),
    Row(
        "rotary_axial",
        {"axis": "A", "harmonics": 1},
        {"A1": 0.003, "B1": -0.001},
        lambda w: {"E_XA": 0.003 * np.cos(w.q["A"]) - 0.001 * np.sin(w.q["A"])},
        machine=FIVE_AXIS,
    ),
    Row(
        "rotary_tilt",
        {"axis": "C", "direction": "X", "harmonics": 1},
        {"A1": 3e-5, "B1": -1e-5},
        lambda w: {"E_AC": 3e-5 * np.cos(w.q["C"]) - 1e-5 * np.sin(w.q["C"])},
        machine=FIVE_AXIS,
    ),
    Row(
        "spindle_location",
        {},
        {"E_X0S": 0.01, "E_Y0S": -0.02, "E_Z0S": 0.035},
        lambda w: {
            **{f"E_{d}(spindle)": v * w.one for d, v in zip("XYZ", _HELD, strict=True)},
            **{f"d{d}": -v * w.one for d, v in zip("XYZ", _HELD, strict=True)},
        },
        machine=HEAD,
    ),
    Row(
        "spindle_squareness",
        {"direction": "X"},
        {"angle": 7e-5},
        lambda w: {"E_B(spindle)": 7e-5 * w.one},
    ),
    Row(
        "spindle_squareness",
        {"direction": "Y"},
        {"angle": 7e-5},
        lambda w: {"E_A(spindle)": -7e-5 * w.one},
        spec="spindle_squareness towards Y",
    ),
    Row(
        "cross_angular",
        {"axis": "Y", "about": "X", "by": "Z"},
        {"kappa": 1e-7},
        lambda w: {"E_AY": 1e-7 * (w.q["Z"] + 225.0)},
    ),
    Row(
        "cross_angular",
        {"axis": "Z", "about": "Y", "by": "X", "product": "true"},
        {"kappa": 1e-10},
        lambda w: {"E_BZ": 1e-10 * (w.q["X"] - 400.0) * w.q["Z"]},
        spec="cross_angular, a product",
    ),
    Row(
        "overhang_sag",
        {"axis": "Z", "direction": "Y", "by": "Z"},
        {"sag": 0.03},
        # the ram reaches down from 0: 450 mm at most; it leans as it deflects
        lambda w: {
            "E_YZ": 0.03 * (-w.q["Z"] / 450) ** 3,
            "E_AZ": 0.03 * 1.5 * (-w.q["Z"]) ** 2 / 450**3,
        },
    ),
    Row(
        "gravity_flexure",
        {"axis": "C"},
        {"sag": 5e-5},
        lambda w: _hanging(w, np.array([0.0, 0.0, -5e-5])),
        machine=FIVE_AXIS,
    ),
    Row(
        "gravity_flexure",
        {"axis": "C", "gravity": "fit"},
        {"gx": 2e-5, "gy": -1e-5, "gz": 3e-5},
        lambda w: _hanging(w, np.array([2e-5, -1e-5, 3e-5])),
        machine=FIVE_AXIS,
        spec="gravity_flexure of a machine that stands in any way",
    ),
    Row(
        "gravity_flexure",
        {"axis": "A", "by": "C", "gravity": "fit"},
        {"gx": 2e-5, "gy": -1e-5, "gz": 3e-5},
        lambda w: _weighing(w, ("A", "C"), np.array([2e-5, -1e-5, 3e-5])),
        machine=FIVE_AXIS,
        spec="gravity_flexure of a table's joint under what another carries",
    ),
    Row(
        "gravity_flexure",
        {"axis": "C", "by": "B", "gravity": "fit"},
        {"gx": 2e-5, "gy": -1e-5, "gz": 3e-5},
        lambda w: _weighing(w, ("C", "B"), np.array([2e-5, -1e-5, 3e-5])),
        machine=HEAD,
        spec="gravity_flexure of a head's joint under what another carries",
    ),
    Row(
        "load_bending",
        {"axis": "X", "signal": "load", "direction": "Z"},
        {"c0": 1e-6, "c1": -2e-6, "c2": 3e-6},
        lambda w: {
            "E_ZX": w.T["load"]
            * (1e-6 - 2e-6 * (w.q["X"] / 400 - 1) + 3e-6 * (1.5 * (w.q["X"] / 400 - 1) ** 2 - 0.5))
        },
    ),
    Row(
        "load_bending",
        {"axis": "Y", "signal": "load", "about": "X", "shape": "constant"},
        {"value": 2e-8},
        lambda w: {"E_AY": 2e-8 * w.T["load"]},
        spec="load_bending, an angle",
    ),
    Row(
        "scale_expansion",
        {"axis": "X", "signals": "T_x,T_screw"},
        {"alpha": 11e-6},
        lambda w: {"E_XX": 11e-6 * w.q["X"] * ((w.T["T_x"] + w.T["T_screw"]) / 2 - 20)},
    ),
    Row(
        "scale_expansion",
        {"axis": "X", "signals": "T_air", "tau": "fit"},
        {"alpha": 11e-6},
        lambda w: {"E_XX": 11e-6 * w.q["X"] * (w.lagged("T_air", 1700.0) - 20)},
        nonlinear={"tau": 1700.0},
        spec="scale_expansion that lags",
    ),
    Row(
        "thermal_offset",
        {"direction": "Z", "signal": "T_front"},
        {"k": -0.004},
        lambda w: {"dZ": -0.004 * (w.T["T_front"] - 20)},
    ),
    Row(
        "thermal_offset",
        {"direction": "Z", "signal": "T_spindle", "tau": "900"},
        {"k": -0.004},
        lambda w: {"E_Z(spindle)": -0.004 * (w.lagged("T_spindle", 900.0) - 20)},
        spec="thermal_offset of a spindle",
    ),
    Row(
        "thermal_offset",
        {"direction": "Z", "signal": "speed", "tau": "fit"},
        {"k": 4e-6},
        lambda w: {"dZ": 4e-6 * w.lagged("speed", 1200.0)},
        nonlinear={"tau": 1200.0},
        spec="thermal_offset by speed",
    ),
    Row(
        "thermal_offset",
        {"direction": "Z", "signal": "T_front", "tau": "fit", "start": "fit"},
        {"k": -0.004},
        lambda w: {"dZ": -0.004 * (w.lagged("T_front", 1200.0) - 20)},
        nonlinear={"tau": 1200.0},
        spec="thermal_offset that began warm",
    ),
    Row(
        "thermal_offset",
        {"direction": "Z", "signal": "speed", "tau": "fit", "tau2": "3600"},
        {"k": 4e-6, "k2": -1e-6},
        lambda w: {"dZ": 4e-6 * w.lagged("speed", 1200.0) - 1e-6 * w.lagged("speed", 3600.0)},
        nonlinear={"tau": 1200.0},
        spec="thermal_offset of two bodies",
    ),
    Row(
        "thermal_bending",
        {"axis": "Z", "about": "X", "signals": "T_front,T_rear"},
        {"kappa": 6e-8},
        lambda w: {"E_AZ": 6e-8 * (w.T["T_front"] - w.T["T_rear"]) * w.q["Z"]},
    ),
    Row(
        "thermal_bending",
        {"axis": "Z", "about": "X", "signals": "T_front,T_rear", "deflection": "true"},
        {"kappa": 6e-8},
        # a beam along Z that turns about X by κΔT·z goes to −Y by half of it times z
        lambda w: {
            "E_AZ": 6e-8 * (w.T["T_front"] - w.T["T_rear"]) * w.q["Z"],
            "E_YZ": -3e-8 * (w.T["T_front"] - w.T["T_rear"]) * w.q["Z"] ** 2,
        },
        spec="thermal_bending with its bending line",
    ),
    Row(
        "thermal_tilt",
        {"axis": "Y", "about": "X", "signals": "T_front,T_rear"},
        {"k": 9e-6},
        lambda w: {"E_AY": 9e-6 * (w.T["T_front"] - w.T["T_rear"])},
    ),
    Row(
        "thermal_tilt",
        {"axis": "Y", "about": "Z", "signal": "T_air", "tau": "fit"},
        {"k": 9e-6},
        lambda w: {"E_CY": 9e-6 * (w.lagged("T_air", 2500.0) - 20)},
        nonlinear={"tau": 2500.0},
        spec="thermal_tilt that lags",
    ),
    Row(
        "screw_heating",
        {"axis": "Y", "signal": "T_screw"},
        {"k": 11.5e-6},
        # −250 and 250 lie equally near to zero: the lower end counts
        lambda w: {"E_YY": 11.5e-6 * (w.q["Y"] + 250) * (w.T["T_screw"] - 20)},
    ),
    Row(
        "screw_heating",
        {"axis": "X", "signal": "feed", "fixed": "800", "tau": "fit"},
        {"k": 1e-8},
        lambda w: {"E_XX": 1e-8 * (w.q["X"] - 800) * w.lagged("feed", 600.0)},
        nonlinear={"tau": 600.0},
        spec="screw_heating by feed",
    ),
    Row(
        "warm_up",
        {"direction": "X"},
        {"A": 0.02},
        lambda w: {"dX": 0.02 * (1 - np.exp(-w.t / 5200))},
        nonlinear={"tau": 5200.0},
    ),
    Row(
        "warm_up",
        {"axis": "C", "tau": 900},
        {"A": 1e-4},
        lambda w: {"E_CC": 1e-4 * (1 - np.exp(-w.t / 900))},
        machine=FIVE_AXIS,
        spec="warm_up of a rotary axis",
    ),
    Row("drift", {"direction": "Y"}, {"rate": 2e-6}, lambda w: {"dY": 2e-6 * w.t}),
    Row(
        "event",
        {"direction": "X"},
        {"step": 0.015},
        lambda w: {"dX": np.where(w.t >= 6000.0, 0.015, 0.0)},
        nonlinear={"t0": 6000.0},
    ),
    Row(
        "feed_lag",
        {"axis": "X", "signal": "feed"},
        {"delay": 0.002},
        lambda w: {"E_XX": 0.002 * w.T["feed"] / 60 * w.s["X"]},
    ),
    Row(
        "workpiece_expansion",
        {"signal": "T_part", "datum": "100,0,-50"},
        {"alpha": 11.5e-6},
        lambda w: {
            f"E_{k}(workpiece)": -11.5e-6 * (w.q[k] + w.tool[:, i] - d) * (w.T["T_part"] - 20)
            for i, (k, d) in enumerate(zip("XYZ", (100.0, 0.0, -50.0), strict=True))
        },
    ),
    Row(
        "dead_path",
        {"setups": "line,bar"},
        {"length": 800.0},
        lambda w: {VALUE: 800.0 * _since_first(w, _edlen(w)) * (w.setup == "line")},
    ),
    Row(
        "air_refraction",
        {},
        {"share": 100.0},
        lambda w: {VALUE: (_along(w) + w.distance) * (_edlen(w) - 1.00027137285)},
    ),
    Row(
        "cosine",
        {"setup": "line"},
        {"theta2": 4e-6},
        # cos θ of the way, θ = 2 mrad
        lambda w: {VALUE: np.where(w.setup == "line", (math.cos(0.002) - 1) * _along(w), 0.0)},
    ),
    Row(
        "instrument_drift",
        {"setup": "level", "measures": "angle"},
        {"rate": 1e-9},
        lambda w: {VALUE: 1e-9 * _since_first(w, w.t) * (w.setup == "level")},
    ),
    Row(
        "stylus_bending",
        {"setups": "line"},
        {"bend": 0.004},
        # F·L³/3EI of the force's part across the stylus, seen in the measured direction
        lambda w: {
            VALUE: 0.004e-6
            * np.linalg.norm(w.tool, axis=1)
            * np.linalg.norm(np.cross(w.tool, w.u), axis=1) ** 2
            * (w.setup == "line")
        },
    ),
    Row(
        "probe_lobing",
        {"setups": "line"},
        {"A": 0.002, "B": -0.001, "C": 0.0005},
        lambda w: {VALUE: _lobes(w, complex(0.002, 0.001), 0.0005) * (w.setup == "line")},
    ),
    Row(
        "gauge_expansion",
        {"signal": "T_part", "setups": "plate"},
        {"alpha": -7e-6},
        lambda w: {VALUE: _scaled(w, -7e-6 * (w.T["T_part"] - 20.0))},
    ),
    Row(
        "length_bias",
        {},
        {"bias": 0.005},
        lambda w: {VALUE: 0.005 * (w.setup == "bar")},
    ),
    Row(
        "length_bias",
        {"base": "B2"},
        {"bias": 0.005},
        lambda w: {VALUE: 0.005 * (w.base == "B2")},
        spec="length_bias of one base",
    ),
    Row("sensor_offset", {"signal": "T_x"}, {"offset": 0.4}, lambda w: {}),
    Row("sensor_gain", {"signal": "T_x"}, {"gain": 0.04}, lambda w: {}),
    Row("sensor_bend", {"signal": "T_x"}, {"bend": 4e-4}, lambda w: {}),
    Row(
        "setup_zero",
        {"setup": "line"},
        {"zero": 0.003},
        lambda w: {VALUE: 0.003 * (w.setup == "line")},
    ),
    Row(
        "setup_slope",
        {"setup": "line"},
        {"slope": 0.003},
        lambda w: {VALUE: 0.003 * _path(w, "line")},
    ),
    Row(
        "setup_scale",
        {"setup": "plate"},
        {"s": 50e-6},
        lambda w: {VALUE: _scaled(w, 50e-6)},
    ),
    Row(
        "setup_frame",
        {"setup": "plate"},
        {"x": 0.1, "y": -0.2, "z": 0.05, "a": 1e-5, "b": -2e-5, "c": 3e-5},
        lambda w: {VALUE: _frame(w)},
    ),
    Row(
        "formula",
        {"channel": "E_ZY", "terms": "X*Y*(T_x-T0), lag(T_air,1700)-T0, sign(X-300)*Y_dir"},
        {"c1": 1e-9, "c2": 0.002, "c3": 0.001},
        lambda w: {
            "E_ZY": 1e-9 * w.q["X"] * w.q["Y"] * (w.T["T_x"] - 20)
            + 0.002 * (w.lagged("T_air", 1700.0) - 20)
            + 0.001 * np.where(w.q["X"] > 300, 1, -1) * w.s["Y"]
        },
    ),
    Row(
        "formula",
        {"channel": "dX", "terms": ["max(abs(Y)-100,0)**2", "exp(-t/600)*cos(2*pi*Z/37)"]},
        {"c1": 1e-6, "c2": 0.002},
        lambda w: {
            "dX": 1e-6 * np.clip(np.abs(w.q["Y"]) - 100, 0, None) ** 2
            + 0.002 * np.exp(-w.t / 600) * np.cos(2 * np.pi * w.q["Z"] / 37)
        },
        spec="formula of the functional point",
    ),
)
