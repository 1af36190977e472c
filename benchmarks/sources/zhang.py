"""Zhang et al.: a moving-bridge CMM, 700 × 900 × 360 mm, ``w b Y X Z t``, with thermal scales.

Every error motion sampled every 50 mm (X, Y) or 20 mm (Z), squareness from opposite diagonals,
scale errors at several temperatures; then more than 50 lines in arbitrary directions, a 515 mm
gauge block in seven orientations, and the error map of a plane. The machine is an exact chain of
rigid bodies whose scales really grow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.comparison.compare import Comparison, compare
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.error_map import worst_pair
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import sensitivities
from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine
from benchmarks.sources.campaigns import Rows

F64 = NDArray[np.float64]

TRAVELS = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}
STEP = {"X": 50.0, "Y": 50.0, "Z": 20.0}
ALPHA = {"X": 16e-6, "Y": 10e-6, "Z": 13e-6}
SQUARENESS = {"YX": 28e-6, "YZ": -17e-6, "XZ": 12e-6}
"""The right-handed turn of the second axis's guideway on what carries it, rad."""
NOISE = 0.5e-3
ANGLE_NOISE = 0.2e-6
TEMPERATURES = (18.0, 19.4, 20.8, 22.2)
U = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
PROBE = (0.0, 0.0, -120.0)
MIDDLE = {a: 0.5 * sum(t) for a, t in TRAVELS.items()}
BLOCK = 515.0


def machine() -> ExactMachine:
    """The machine: smooth error motions of some µm and µrad, three scales that grow."""
    rng = np.random.default_rng(1985)
    mounts = {
        "X": (0.0, 0.0, 0.0, 0.0, 0.0, SQUARENESS["YX"]),
        # Z stands on X, which stands on Y: both squarenesses of Z are its own mounting's
        "Z": (0.0, 0.0, 0.0, SQUARENESS["YZ"], SQUARENESS["XZ"], 0.0),
    }
    axes = {}
    for name, (low, high) in TRAVELS.items():
        amplitude = rng.normal(size=(6, 4)) / np.array([1.0, 2.0, 4.0, 8.0])
        amplitude *= np.array([4e-3, 3e-3, 3e-3, 9e-6, 9e-6, 9e-6])[:, None]
        phase = rng.uniform(0.0, 2.0 * np.pi, (6, 4))
        rate = np.pi * np.array([0.7, 1.3, 2.1, 3.0]) / (high - low)

        def six(state, name=name, amplitude=amplitude, phase=phase, rate=rate):  # type: ignore[no-untyped-def]
            q = np.asarray(state[name], dtype=np.float64)
            return (amplitude * np.sin(np.multiply.outer(q, rate)[..., None, :] + phase)).sum(-1)

        def grown(state, name=name):  # type: ignore[no-untyped-def]
            warm = 0.5 * (state[f"T_{name.lower()}1"] + state[f"T_{name.lower()}2"]) - 20.0
            return np.asarray(state[name]) * (1.0 + ALPHA[name] * warm)

        axes[name] = ExactAxis(
            error=six, actual=grown, mount=mounts.get(name, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        )
    return ExactMachine("w b Y X Z t", axes, TRAVELS)


def thermometers(mean: float, time: F64) -> dict[str, F64]:
    """Six thermistors on three scales: slowly drifting, never quite alike."""
    found = {}
    for k, name in enumerate(("x1", "x2", "y1", "y2", "z1", "z2")):
        drift = 0.15 * np.sin(time / (2500.0 + 400.0 * k) + k)
        found[f"T_{name}"] = mean + 0.12 * (k - 2.5) + drift
    return found


def _add(
    rows: Rows,
    exact: ExactMachine,
    rng: np.random.Generator,
    setup: str,
    kind: Kind,
    positions: Mapping[str, F64 | float],
    u: F64 | tuple[float, float, float],
    mean: float = 20.0,
    free: tuple[str, ...] = ("zero",),
    start: float = 0.0,
) -> None:
    n = max(np.size(v) for v in positions.values())
    time = start + 20.0 * np.arange(n)
    signals = thermometers(mean, time)
    state = {a: np.broadcast_to(v, (n,)) for a, v in positions.items()} | signals
    if kind == Kind.DISPLACEMENT:
        value = exact.error(state, PROBE) @ np.asarray(u) + rng.normal(0.0, NOISE, n)
        sd = NOISE
    else:
        value = exact.orientation_error(state) @ np.asarray(u) + rng.normal(0.0, ANGLE_NOISE, n)
        sd = ANGLE_NOISE
    # the instrument's arbitrary zero
    value = value + rng.normal() * 40.0 * sd
    read = {k: np.round(v + rng.normal(0.0, 0.01, n), 3) for k, v in signals.items()}
    rows.add(setup, kind, positions, value, sd, u=u, free=free, tool=PROBE, time=time, signals=read)


def calibration(exact: ExactMachine, seed: int) -> Campaign:
    """The 18 functions, diagonals for the squarenesses, scale errors at three temperatures."""
    rng = np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    clock = 0.0
    for a, travel in TRAVELS.items():
        q = np.arange(travel[0], travel[1] + 1.0, STEP[a])
        there_and_back = np.tile(np.concatenate([q, q[::-1]]), 2)
        place = {**MIDDLE, a: there_and_back}
        for mean in TEMPERATURES:
            name = f"{a} position {mean:g}"
            _add(rows, exact, rng, name, Kind.DISPLACEMENT, place, U[a], mean, start=clock)
            clock += 1500.0
        for k in "XYZ":
            if k != a:
                free = ("zero", "slope")
                name = f"{a} straightness {k}"
                _add(rows, exact, rng, name, Kind.DISPLACEMENT, place, U[k], free=free, start=clock)
            _add(rows, exact, rng, f"{a} about {k}", Kind.ROTATION, place, U[k], start=clock)
            clock += 1500.0
    for one, two in ("XY", "XZ", "YZ"):
        for way in (1, -1):
            part = np.tile(np.linspace(0.0, 1.0, 41), 16)
            along = TRAVELS[one][0] + np.ptp(TRAVELS[one]) * (part if way > 0 else 1.0 - part)
            up = TRAVELS[two][0] + np.ptp(TRAVELS[two]) * part
            step = way * np.ptp(TRAVELS[one]) * np.array(U[one]) + np.ptp(TRAVELS[two]) * np.array(
                U[two]
            )
            u = tuple(step / np.linalg.norm(step))
            place = {**MIDDLE, one: along, two: up}
            name = f"{one}{two} diagonal {'+' if way > 0 else '-'}"
            _add(rows, exact, rng, name, Kind.DISPLACEMENT, place, u, start=clock)
            clock += 1500.0
    return rows.campaign("calibration")


def model() -> Model:
    """18 tables at the sampled positions, three squarenesses, three thermal scales."""
    axes = {a: Axis(a, t) for a, t in TRAVELS.items()}
    signals = {
        f"T_{a.lower()}{k}": Signal(f"T_{a.lower()}{k}", "degC", "scale", a)
        for a in "XYZ"
        for k in (1, 2)
    }
    described = Machine("bridge CMM", Structure.parse("w b Y X Z t"), axes, signals)
    effects: list[Effect] = []
    for a, travel in TRAVELS.items():
        nodes = [float(q) for q in np.arange(travel[0], travel[1] + 1.0, STEP[a])]
        table = {"axis": a, "shape": "table", "positions": nodes}
        effects.append(make_effect("positioning", table))
        for k in "XYZ":
            effects.append(make_effect("angular", table | {"about": k}))
            if k != a:
                effects.append(make_effect("straightness", table | {"direction": k}))
        own = [s for s, signal in signals.items() if signal.axis == a]
        effects.append(make_effect("scale_expansion", {"axis": a, "signals": own}))
    effects += [make_effect("squareness", {"axes": list(pair)}) for pair in ("YX", "YZ", "XZ")]
    return Model(described).with_effects(*effects)


def check_lines(exact: ExactMachine, seed: int, count: int = 56) -> Campaign:
    """Lines in arbitrary directions, at other temperatures than the calibration."""
    rng = np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    low, high = (np.array([t[k] for t in TRAVELS.values()]) for k in (0, 1))
    made = 0
    while made < count:
        ends = rng.uniform(low, high, (2, 3))
        step = ends[1] - ends[0]
        length = float(np.linalg.norm(step))
        if length < 300.0:
            continue
        at = ends[0] + np.linspace(0.0, 1.0, 21)[:, None] * step
        place = {a: at[:, k] for k, a in enumerate("XYZ")}
        mean = float(rng.uniform(19.0, 21.5))
        start = 60_000.0 + 700.0 * made
        name = f"line {made + 1}"
        u = tuple(step / length)
        _add(rows, exact, rng, name, Kind.DISPLACEMENT, place, u, mean, start=start)
        made += 1
    return rows.campaign("lines")


def shear(translation: F64, one: str, two: str, places: Conditions) -> F64:
    """Squareness of two axes from errors on a line along each: what no choice of frame changes.

    Slope of the error across on the first line plus that on the second, rad; `translation` has
    shape (2m, 3, …), the first half along axis `one`.
    """
    m = places.n // 2
    i, j = "XYZ".index(one), "XYZ".index(two)
    total = np.zeros(translation.shape[2:])
    for rows, axis, k in ((slice(0, m), one, j), (slice(m, None), two, i)):
        q = places.position(axis)[rows]
        weights = (q - q.mean()) / ((q - q.mean()) ** 2).sum()
        total = total + np.tensordot(weights, translation[rows, k], axes=1)
    return total


def squarenesses(exact: ExactMachine, fitted: Model) -> dict[str, tuple[float, float, float]]:
    """Pair → (true, fitted, stated standard uncertainty), rad, at 20 °C through the middle."""
    found = {}
    for one, two in ("XY", "XZ", "YZ"):
        lines = []
        for a in (one, two):
            q = np.linspace(*TRAVELS[a], 41)
            lines.append({**{k: np.full(41, v) for k, v in MIDDLE.items()}, a: q})
        positions = {a: np.concatenate([line[a] for line in lines]) for a in "XYZ"}
        signals = {name: np.full(82, 20.0) for name in fitted.machine.signals}
        places = Conditions(positions, tool=np.tile(PROBE, (82, 1)), signals=signals)
        true = exact.error({**positions, **signals}, PROBE)
        predicted = fitted.predict(places).translation
        moved, _ = sensitivities(fitted, places)
        slope = shear(moved, one, two, places)
        assert fitted.covariance is not None
        sd = float(np.sqrt(slope @ fitted.covariance @ slope))
        found[one + two] = (
            float(shear(true, one, two, places)),
            float(shear(predicted, one, two, places)),
            sd,
        )
    return found


def gauge_block(exact: ExactMachine, fitted: Model, seed: int) -> list[tuple[str, float, float]]:
    """The block's error of length in seven orientations, µm: (orientation, before, after)."""
    rng = np.random.default_rng(seed)
    steps = {
        "X": (1, 0, 0),
        "Y": (0, 1, 0),
        "XY +": (1, 1, 0),
        "XY −": (-1, 1, 0),
        "XZ": (1, 0, 0.45),
        "YZ": (0, 1, 0.45),
        "XYZ": (1, 1, 0.5),
    }
    found = []
    centre = np.array(list(MIDDLE.values()))
    for name, way in steps.items():
        u = np.array(way, dtype=np.float64)
        u /= np.linalg.norm(u)
        ends = centre + np.array([[-0.5], [0.5]]) * BLOCK * u
        mean = float(rng.uniform(19.3, 20.9))
        signals = thermometers(mean, np.full(2, rng.uniform(0.0, 1e4)))
        positions = {a: ends[:, k] for k, a in enumerate("XYZ")}
        true = exact.error({**positions, **signals}, PROBE) @ u
        probed = true + rng.normal(0.0, 0.2e-3, 2)
        tool = np.tile(PROBE, (2, 1))
        predicted = (
            fitted.predict(Conditions(positions, tool=tool, signals=signals)).translation @ u
        )
        # a CMM reads what its scales say: too short where the machine goes too far
        found.append(
            (name, -float(np.diff(probed)[0]) * 1e3, -float(np.diff(probed - predicted)[0]) * 1e3)
        )
    return found


@dataclass(frozen=True)
class PlaneMap:
    """The plane Z = −330 mm: worst pair of points and its error of length, mm."""

    true: tuple[tuple[float, float], tuple[float, float], float]
    left: float
    predicted: float


def plane_map(exact: ExactMachine, fitted: Model, temperature: float) -> PlaneMap:
    """The worst pair before, what the model says of it, and the worst that it would leave."""
    x, y = (g.ravel() for g in np.meshgrid(np.arange(0, 701, 50.0), np.arange(0, 901, 50.0)))
    n = len(x)
    positions = {"X": x, "Y": y, "Z": np.full(n, -330.0)}
    signals = {name: np.full(n, temperature) for name in fitted.machine.signals}
    true = exact.error({**positions, **signals}, PROBE)
    conditions = Conditions(positions, tool=np.tile(PROBE, (n, 1)), signals=signals)
    predicted = fitted.predict(conditions).translation
    point = np.stack([x, y, positions["Z"]], axis=1)
    i, j, worst = worst_pair(point, true)
    u = (point[i] - point[j]) / np.linalg.norm(point[i] - point[j])
    _, _, left = worst_pair(point, true - predicted)
    return PlaneMap(
        ((float(x[i]), float(y[i])), (float(x[j]), float(y[j])), worst),
        left,
        float(u @ (predicted[i] - predicted[j])),
    )


@dataclass(frozen=True)
class Study:
    """The whole experiment."""

    result: FitResult
    squareness: dict[str, tuple[float, float, float]]
    expansion: dict[str, tuple[float, float]]
    lines: Comparison
    block: list[tuple[str, float, float]]
    plane: dict[float, PlaneMap]


def run(seed: int) -> Study:
    """Calibrate, fit, and measure what is left with what was not fitted."""
    exact = machine()
    result = fit(model(), calibration(exact, seed))
    expansion = {}
    for term in result.model.terms:
        if term.effect.kind == "scale_expansion":
            alpha = term.values["alpha"]
            assert alpha.sd is not None
            expansion[str(term.effect.where()["axis"])] = (alpha.value, alpha.sd)
    return Study(
        result,
        squarenesses(exact, result.model),
        expansion,
        compare(result.model, check_lines(exact, seed + 1)),
        gauge_block(exact, result.model, seed + 2),
        {t: plane_map(exact, result.model, t) for t in (20.0, 19.0)},
    )
