"""ISO/TR 16907: direct measurement in its order, indirect measurement, superposition, validation.

The bridge of `zhang` at 20 °C. *Direct* (10.3): angles first, then positioning and straightness
freed from the angles' levers, then squareness from diagonals, each step with pencil and paper
(interpolated tables, no least squares over all). *Indirect* (7): distances from four base points
with two probes, all at once. Both are held against each other, against what Abbe's fit makes of the
direct measurements, and against the exact machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Tool
from abbe.compcore.comparison.compare import compare
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.design.superposition import uncompensated
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import sensitivities
from benchmarks.sources import zhang
from benchmarks.sources.campaigns import Rows

F64 = NDArray[np.float64]

REFERENCE = {f"T_{a}{k}": 20.0 for a in "xyz" for k in (1, 2)}
BASES = {
    "B1": (-150.0, -100.0, -480.0),
    "B2": (850.0, -150.0, -200.0),
    "B3": (300.0, 1050.0, -450.0),
    "B4": (900.0, 1000.0, -50.0),
}
PROBES = {"P1": (0.0, 0.0, -120.0), "P2": (60.0, 40.0, -180.0)}
_LINES = {"X": (450.0, -180.0), "Y": (350.0, -180.0), "Z": (350.0, 450.0)}


def geometry(*, shape: str = "table") -> Model:
    """18 error motions and three squarenesses: the tables of `zhang`, or another shape."""
    full = zhang.model()
    effects: list[Effect] = []
    for effect in full.effects:
        if effect.kind == "scale_expansion":
            continue
        keys = dict(effect.where())
        if shape != "table" and "shape" in keys:
            keys.pop("positions", None)
            keys["shape"] = shape
        effects.append(make_effect(effect.kind, keys))
    return Model(full.machine).with_effects(*effects)


def direct_campaign(seed: int, active: Model | None = None) -> Campaign:
    """Lines, levels and diagonals at 20 °C; with a compensation active if one is given.

    A compensated machine goes elsewhere by minus what its tables say; its angles stay as they are.
    """
    exact, rng = zhang.machine(), np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))

    def add(
        setup: str,
        kind: Kind,
        place: Mapping[str, F64 | float],
        u: F64 | tuple[float, float, float],
        free: tuple[str, ...] = ("zero",),
    ) -> None:
        n = max(np.size(v) for v in place.values())
        positions = {a: np.broadcast_to(np.asarray(v, dtype=float), (n,)) for a, v in place.items()}
        state = {**positions, **{k: np.full(n, v) for k, v in REFERENCE.items()}}
        if kind == Kind.DISPLACEMENT:
            error = exact.error(state, zhang.PROBE)
            if active is not None:
                error = error - active.predict(_conditions(positions)).translation
            value, sd = error @ np.asarray(u), zhang.NOISE
        else:
            value, sd = exact.orientation_error(state) @ np.asarray(u), zhang.ANGLE_NOISE
        value = value + rng.normal(0.0, sd, n) + rng.normal() * 40.0 * sd
        signals = {k: np.full(n, v) for k, v in REFERENCE.items()}
        rows.add(setup, kind, place, value, sd, u=u, free=free, tool=zhang.PROBE, signals=signals)

    for a, travel in zhang.TRAVELS.items():
        q = np.tile(np.arange(travel[0], travel[1] + 1.0, zhang.STEP[a]), 4)
        place = {**zhang.MIDDLE, a: q}
        add(f"{a} position", Kind.DISPLACEMENT, place, zhang.U[a])
        for k in "XYZ":
            add(f"{a} about {k}", Kind.ROTATION, place, zhang.U[k])
            if k != a:
                free = ("zero", "slope")
                add(f"{a} straightness {k}", Kind.DISPLACEMENT, place, zhang.U[k], free)
    for one, two, way in diagonals():
        u, place = _diagonal(one, two, way, 41, 8)
        add(f"{one}{two} diagonal {way:+d}", Kind.DISPLACEMENT, place, u)
    return rows.campaign("direct")


def diagonals() -> list[tuple[str, str, int]]:
    """Both diagonals of the three planes."""
    return [(one, two, way) for one, two in ("XY", "XZ", "YZ") for way in (1, -1)]


def _diagonal(
    one: str, two: str, way: int, points: int, passes: int
) -> tuple[tuple[float, float, float], dict[str, F64 | float]]:
    part = np.tile(np.linspace(0.0, 1.0, points), passes)
    low, span = zhang.TRAVELS[one][0], np.ptp(zhang.TRAVELS[one])
    along = low + span * (part if way > 0 else 1.0 - part)
    up = zhang.TRAVELS[two][0] + np.ptp(zhang.TRAVELS[two]) * part
    step = way * span * np.array(zhang.U[one]) + np.ptp(zhang.TRAVELS[two]) * np.array(zhang.U[two])
    x, y, z = step / np.linalg.norm(step)
    return (float(x), float(y), float(z)), {**zhang.MIDDLE, one: along, two: up}


def _conditions(positions: Mapping[str, F64], tool: F64 | None = None) -> Conditions:
    n = len(next(iter(positions.values())))
    probe = np.tile(zhang.PROBE, (n, 1)) if tool is None else tool
    return Conditions(
        positions, tool=probe, signals={k: np.full(n, v) for k, v in REFERENCE.items()}
    )


class ByHand:
    """The direct measurements evaluated in the order of 10.3, with nothing but averages.

    Parameters
    ----------
    campaign
        From `direct_campaign`.
    """

    def __init__(self, campaign: Campaign) -> None:
        self._tables: dict[tuple[str, str], tuple[F64, F64]] = {}
        self._campaign = campaign
        for a in "XYZ":
            for k, letter in zip("XYZ", "ABC", strict=True):
                self._tables[a, letter] = self._averaged(f"{a} about {k}", a)
        for a in "XYZ":
            for k in "XYZ":
                name = f"{a} position" if a == k else f"{a} straightness {k}"
                q, value = self._averaged(name, a)
                place = {b: np.full(len(q), zhang.MIDDLE[b]) for b in "XYZ"} | {a: q}
                value = value - self._tilt(a, place)[:, "XYZ".index(k)]
                if a != k:
                    value = value - np.polynomial.Polynomial.fit(q, value, 1)(q)
                self._tables[a, k] = q, value - value.mean()
        self._square = {"XY": 0.0, "XZ": 0.0, "YZ": 0.0}
        self._square = {pair: self._squareness(pair[0], pair[1]) for pair in self._square}

    def _averaged(self, setup: str, axis: str) -> tuple[F64, F64]:
        rows = self._campaign.conditions.setup == setup
        q, number = np.unique(self._campaign.conditions.position(axis)[rows], return_inverse=True)
        total = np.bincount(number, weights=self._campaign.value[rows])
        value = total / np.bincount(number)
        return q, value - value.mean()

    def _motion(self, axis: str, letter: str, q: F64) -> F64:
        return np.interp(q, *self._tables[axis, letter])

    def _tilt(self, axis: str, place: Mapping[str, F64]) -> F64:
        """What one axis's angles do at the probe: its lever is all that stands behind its move."""
        behind = {"Y": "XZ", "X": "Z", "Z": ""}[axis]
        n = len(place["X"])
        arm = np.tile(np.asarray(zhang.PROBE), (n, 1))
        for other in behind:
            arm[:, "XYZ".index(other)] += place[other]
        turn = np.stack([self._motion(axis, k, place[axis]) for k in "ABC"], axis=1)
        return np.cross(turn, arm)

    def _squareness(self, one: str, two: str) -> float:
        """Half the difference of the opposite diagonals' slopes is the squareness's."""
        slopes = []
        for way in (1, -1):
            u, place = _diagonal(one, two, way, 41, 1)
            rows = self._campaign.conditions.setup == f"{one}{two} diagonal {way:+d}"
            value = self._campaign.value[rows].reshape(-1, 41).mean(axis=0)
            positions = {a: np.broadcast_to(v, (41,)) for a, v in place.items()}
            left = value - self.error(positions) @ np.asarray(u)
            length = np.hypot(np.ptp(zhang.TRAVELS[one]), np.ptp(zhang.TRAVELS[two]))
            slopes.append(
                np.polynomial.Polynomial.fit(np.linspace(0, length, 41), left, 1).deriv()(0)
            )
        reach = np.ptp(zhang.TRAVELS[one]), np.ptp(zhang.TRAVELS[two])
        sine_cosine = reach[0] * reach[1] / (reach[0] ** 2 + reach[1] ** 2)
        return float(0.5 * (slopes[0] - slopes[1]) / sine_cosine)

    def error(self, positions: Mapping[str, F64]) -> F64:
        """The error at the probe, (n, 3), mm."""
        place = {a: np.asarray(q, dtype=float) for a, q in positions.items()}
        total = np.zeros((len(place["X"]), 3))
        for a in "XYZ":
            total += self._tilt(a, place)
            total += np.stack([self._motion(a, k, place[a]) for k in "XYZ"], axis=1)
        for pair, angle in getattr(self, "_square", {}).items():
            # shear: the second coordinate moves the error along the first
            first, second = pair
            offset = place[second] - zhang.MIDDLE[second]
            total[:, "XYZ".index(first)] += angle * offset
        return total


def indirect_campaign(seed: int) -> Campaign:
    """Distances of 400 random places from four base points, with two probes, in random order."""
    exact, rng = zhang.machine(), np.random.default_rng(seed)
    rows = Rows(("X", "Y", "Z"))
    for base, where in BASES.items():
        for probe, offset in PROBES.items():
            place = {a: rng.uniform(*t, 400) for a, t in zhang.TRAVELS.items()}
            state = {**place, **{k: np.full(400, v) for k, v in REFERENCE.items()}}
            lengths = np.linalg.norm(exact.point(state, offset) - np.asarray(where), axis=1)
            signals = {k: np.full(400, v) for k, v in REFERENCE.items()}
            rows.add(
                f"{base} {probe}",
                Kind.DISTANCE,
                place,
                lengths + rng.normal(0.0, zhang.NOISE, 400),
                zhang.NOISE,
                free=(),
                tool_name=probe,
                base=base,
                signals=signals,
            )
    stated = {
        name: tuple(np.round(np.add(where, rng.uniform(-1.0, 1.0, 3)), 1))
        for name, where in BASES.items()
    }
    tools = {name: Tool(name, offset) for name, offset in PROBES.items()}
    order = rng.permutation(400 * len(BASES) * len(PROBES))
    return rows.campaign("indirect", bases=stated, tools=tools, order=order)


@dataclass(frozen=True)
class Agreement:
    """Two ways to the same errors, or one way and the truth, compared at random places.

    Attributes
    ----------
    rms
        Root mean square of the difference, rigid displacements taken out, mm.
    within
        Share of the differences within their stated 95 % interval; NaN where none is stated.
    """

    rms: float
    within: float


@dataclass(frozen=True)
class Study:
    """All of it."""

    direct: FitResult
    indirect: FitResult
    agreement: dict[str, Agreement]
    superposed: dict[str, float]


def places(seed: int = 7, n: int = 60) -> dict[str, F64]:
    """Random places in the volume, away from the ends of the travels by 3 %."""
    rng = np.random.default_rng(seed)
    inset = {a: 0.03 * np.ptp(t) for a, t in zhang.TRAVELS.items()}
    return {a: rng.uniform(t[0] + inset[a], t[1] - inset[a], n) for a, t in zhang.TRAVELS.items()}


def _rigid(positions: Mapping[str, F64]) -> F64:
    """Orthonormal basis of rigid displacements at the places, (3n, 6)."""
    point = np.stack([positions[a] for a in "XYZ"], axis=1)
    columns = []
    for k in range(3):
        unit = np.zeros(3)
        unit[k] = 1.0
        columns += [np.tile(unit, (len(point), 1)), np.cross(unit, point)]
    return np.linalg.qr(np.stack([c.ravel() for c in columns], axis=1))[0]


def run(seed: int) -> Study:
    """Measure twice, evaluate three ways, compare; then compensate a compensated machine."""
    exact = zhang.machine()
    campaign = direct_campaign(seed)
    direct = fit(geometry(), campaign)
    indirect = fit(geometry(shape="spline:9"), indirect_campaign(seed + 1))
    where = places()
    conditions = _conditions(where)
    state = {**where, **{k: np.full(conditions.n, v) for k, v in REFERENCE.items()}}
    fields = {
        "truth": exact.error(state, zhang.PROBE),
        "by hand": ByHand(campaign).error(where),
        "direct": direct.model.predict(conditions).translation,
        "indirect": indirect.model.predict(conditions).translation,
    }
    rigid = _rigid(where)
    spread = {
        "direct": _covariance(direct.model, conditions, rigid),
        "indirect": _covariance(indirect.model, conditions, rigid),
    }
    agreement = {}
    for one, two in (
        ("by hand", "truth"),
        ("direct", "truth"),
        ("indirect", "truth"),
        ("by hand", "direct"),
        ("direct", "indirect"),
    ):
        apart = (fields[one] - fields[two]).ravel()
        apart -= rigid @ (rigid.T @ apart)
        variance = spread.get(one, 0.0) + spread.get(two, 0.0)
        stated = one in spread and (two in spread or two == "truth")
        within = float((np.abs(apart) <= 1.96 * np.sqrt(variance)).mean()) if stated else np.nan
        agreement[f"{one} – {two}"] = Agreement(float(np.sqrt(np.mean(apart**2))), within)
    return Study(direct, indirect, agreement, superposition(seed + 2))


def _covariance(model: Model, conditions: Conditions, rigid: F64) -> F64:
    """Variances of the predictions with rigid displacements taken out, (3n,)."""
    moved, _ = sensitivities(model, conditions)
    flat = moved.reshape(-1, moved.shape[2])
    flat = flat - rigid @ (rigid.T @ flat)
    assert model.covariance is not None
    return np.einsum("np,pq,nq->n", flat, model.covariance, flat)


def superposition(seed: int) -> dict[str, float]:
    """RMS on lines that were never fitted, mm: bare, with old tables, with superposed tables.

    The old tables are a fit of only the linear parts; then the machine is measured with them.
    ``unaware`` adds what comes of fitting those measurements as if no compensation were active.
    """
    exact = zhang.machine()
    old = fit(geometry(shape="polynomial:1"), direct_campaign(seed)).model
    measured = direct_campaign(seed + 1, active=old)
    new = fit(geometry(), uncompensated(measured, old)).model
    unaware = fit(geometry(), measured).model
    lines = zhang.check_lines(exact, seed + 2)
    # scales at other temperatures are another matter here
    still = _at_reference(exact, lines)
    bare = compare(geometry(), still).lengths.rms
    return {
        "bare": bare,
        "old": compare(old, still).lengths.rms,
        "superposed": compare(new, still).lengths.rms,
        "unaware": _sum_rms(old, unaware, still),
    }


def _at_reference(exact, lines: Campaign) -> Campaign:  # type: ignore[no-untyped-def]
    """The same lines measured at 20 °C."""
    from dataclasses import replace

    c = lines.conditions
    rng = np.random.default_rng(3)
    signals = {k: np.full(c.n, v) for k, v in REFERENCE.items()}
    assert c.u is not None
    value = np.einsum("ni,ni->n", exact.error({**c.positions, **signals}, zhang.PROBE), c.u)
    conditions = replace(c, signals=signals, kind=None)
    return replace(lines, conditions=conditions, value=value + rng.normal(0.0, zhang.NOISE, c.n))


def _sum_rms(old: Model, new: Model, lines: Campaign) -> float:
    """RMS when the new tables are added to the old ones."""
    from dataclasses import replace

    predicted = old.predict(lines.conditions).translation
    assert lines.conditions.u is not None
    left = lines.value - np.einsum("ni,ni->n", predicted, lines.conditions.u)
    return compare(new, replace(lines, value=left)).lengths.rms
