"""Pictures of what each effect does to the volume: before in grey, after in colour, exaggerated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects import make_effect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import INSTRUMENT, ErrorMotion
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.model.model import Model, Term, Value
from tools.effect_scenes import SIGNALS, Scene
from tools.svg import Drawing

F64 = NDArray[np.float64]

WIDTH, HEIGHT = 760, 330
_STYLE = (
    ".ground{fill:#fff}text{font:12px sans-serif;fill:#333}.small{font-size:11px;fill:#666}"
    "path{fill:none;stroke-linejoin:round}.before{stroke:#bbb;stroke-width:.8}"
    ".after{stroke:#1565c0;stroke-width:1.3}.other{stroke:#e07b00;stroke-width:1.3}"
    ".rule{stroke:#999;stroke-width:.8}.zero{stroke:#ccc;stroke-width:.8;stroke-dasharray:3 3}"
    ".dot{fill:#1565c0}.base{fill:#333}"
)
_LOOKS = ("after", "other")
_SPHERE = 100.0
"""mm: radius of the sphere that is drawn."""

_BOXED = ("line", "rays", "plate", "pins")
_POINTS = 49
_REACH = 0.10
"""Largest drawn displacement, as a part of the volume's diagonal."""


def picture(kind: str, scene: Scene) -> str:
    """The SVG text of an effect's picture."""
    drawing = Drawing(WIDTH, HEIGHT, _STYLE)
    stage = _Stage(kind, scene)
    stage.draw(drawing)
    _diagram(drawing, stage)
    drawing.text(12, HEIGHT - 12, scene.caption)
    return drawing.render(f"{kind}: {scene.caption}")


class _Stage:
    """An effect with values, and the volume that it deforms."""

    def __init__(self, kind: str, scene: Scene) -> None:
        self.scene, self.machine = scene, scene.machine
        self.effect = scene.effect(kind)
        self.term = Term(self.effect, {k: Value(v) for k, v in scene.values.items()})
        others = tuple(
            Term(make_effect(k, keys), {n: Value(v) for n, v in values.items()})
            for k, keys, values in scene.others
        )
        self.model = Model(self.machine, (*others, self.term))
        self.plain = Model(self.machine, others)

    def conditions(self, rows: Mapping[str, F64], changed: Mapping[str, float]) -> Conditions:
        """Rows of positions, time and signals; what is not given comes from the scene's state."""
        state = {**self.scene.state, **changed}
        n = len(next(iter(rows.values())))

        def column(name: str, other: float) -> F64:
            return rows.get(name, np.full(n, state.get(name, other)))

        axes = self.machine.structure.axes
        middle = {a: self.machine.axis(a).middle for a in axes}
        normal = {k: 20.0 if s.temperature else 0.0 for k, s in SIGNALS.items()} | {
            "p_air": 1013.25
        }
        tool = np.zeros((n, 3))
        tool[:, 2] = -column("tool", 0.0)
        toward = np.tile(np.eye(3)["XYZ".index(self.scene.u)], (n, 1))
        if "around" in rows:
            around = np.deg2rad(rows["around"])
            toward = np.stack([np.cos(around), np.sin(around), np.zeros(n)], axis=1)
        if "ux" in rows:
            toward = np.stack([rows["ux"], rows["uy"], rows["uz"]], axis=1)
        return Conditions(
            positions={a: column(a, middle[a]) for a in axes},
            directions={a: column(f"{a}_dir", 0.0) for a in axes},
            tool=tool,
            time=column("t", 0.0),
            signals={k: column(k, normal[k]) for k in SIGNALS},
            setup=np.full(n, "line"),
            u=toward,
            base=np.full(n, "B" if self.scene.look == "rays" else ""),
            kind=np.full(n, 2 if self.scene.look == "rays" else 0, dtype=np.int8),
        )

    def displaced(self, at: Conditions) -> F64:
        """What the effect does at rows, (n, 3), mm: error, or the measured value along u."""
        if self.effect.scope != "instrument":
            return self.model.predict(at).translation
        if self.effect.reads_model:
            return self.model.predict(at).translation - self.plain.predict(at).translation
        unit = np.zeros((at.n, 3)) if at.u is None else at.u
        return self.motion(at)[:, None] * unit

    def motion(self, at: Conditions) -> F64:
        """The effect's first error motion (or measured value) at rows, (n,), mm or rad."""
        total = np.zeros(at.n)
        p = self.term.coefficients(self.machine)
        motions = self.effect.motions_among(self.machine, at, {}, self.plain.terms)
        for motion in motions:
            if motion.error_motion == self.error_motion:
                total += motion.amount(p)
        return total

    @property
    def error_motion(self) -> ErrorMotion:
        """The error motion that moves most."""
        axes = self.machine.structure.axes
        at = self.conditions({a: np.linspace(*self.machine.axis(a).travel, 7) for a in axes}, {})
        p = self.term.coefficients(self.machine)
        size: dict[ErrorMotion, float] = {}
        for m in self.effect.motions_among(self.machine, at, {}, self.plain.terms):
            value = np.abs(m.amount(p)).max()
            scaled = value * (300.0 if m.error_motion.rotation else 1.0)
            size[m.error_motion] = max(size.get(m.error_motion, 0.0), float(scaled))
        return max(size, key=lambda error_motion: size[error_motion])

    # --- the volume -------------------------------------------------------------------------

    def strokes(self) -> list[dict[str, F64]]:
        """Rows of positions of each line that is drawn."""
        look = self.scene.look
        if look == "rings":
            return [*self._rings(), *self._spokes()]
        if look == "pins":
            return self._pins()
        if look == "plate":
            return self._lattice({"X": 5, "Y": 6, "Z": 1})
        if look in ("line", "rays"):
            return [self._line()]
        if look == "sphere":
            return self._touches()
        return self._lattice(dict(zip("XYZ", self.scene.count, strict=True)))

    def _touches(self) -> list[dict[str, F64]]:
        """Circles around a sphere, drawn large, touched outwards; and from its pole down."""
        around = np.linspace(0.0, 2.0 * np.pi, 49)
        down = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 25)
        circles = [(np.full(49, a), around) for a in (0.5 * np.pi, 1.0, 0.5)]
        arcs = [(down, np.full(25, a)) for a in (0.0, 0.5 * np.pi)]
        out = []
        for polar, turn in circles + arcs:
            u = np.stack(
                [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)]
            )
            at = np.array([[350.0], [450.0], [0.0]]) + _SPHERE * u
            at[2] += self.scene.state["tool"]
            out.append(dict(zip(("X", "Y", "Z", "ux", "uy", "uz"), (*at, *u), strict=True)))
        return out

    def _line(self) -> dict[str, F64]:
        steps = np.linspace(*self.machine.axis("X").travel, 15)
        hours = self.scene.curve.span if self.scene.curve.over == "t" else (0.0, 0.0)
        return {"X": steps, "t": np.linspace(*hours, 15) * 3600.0} | self._weather(15)

    def _weather(self, n: int) -> dict[str, F64]:
        if self.scene.curve.over != "t" or self.effect.kind != "dead_path":
            return {}
        return {"T_air": np.linspace(20.0, 23.0, n)}

    def _lattice(self, count: Mapping[str, int]) -> list[dict[str, F64]]:
        axes = "XYZ"
        travel = {a: self.machine.axis(a).travel for a in axes}
        grid = {
            a: np.linspace(*travel[a], count[a]) if count[a] > 1 else np.array([-180.0])
            for a in axes
        }
        found = []
        for along in axes:
            if count[along] == 1:
                continue
            one, two = (a for a in axes if a != along)
            for p in grid[one]:
                for q in grid[two]:
                    if len(grid["Z"]) > 1 and _inside(p, grid[one]) and _inside(q, grid[two]):
                        continue  # the surface is enough, and can be seen through
                    run = np.linspace(*travel[along], _POINTS)
                    found.append({along: run, one: np.full(_POINTS, p), two: np.full(_POINTS, q)})
        return found

    def _rings(self) -> list[dict[str, F64]]:
        turn = np.linspace(-math.pi, math.pi, 49)
        still = np.ones(49)
        return [
            {"C": turn, **self._out(radius * still), "Z": height * still}
            for height in (0.0, 200.0)
            for radius in (120.0, 240.0)
        ]

    def _out(self, radius: F64) -> dict[str, F64]:
        along = self.scene.u
        return {a: radius if a == along else np.zeros_like(radius) for a in "XY"}

    def _spokes(self) -> list[dict[str, F64]]:
        out = np.array([0.0, 240.0])
        return [
            {"C": np.full(2, angle), **self._out(out), "Z": np.full(2, height)}
            for height in (0.0, 200.0)
            for angle in np.arange(-180.0, 180.0, 30.0) * math.pi / 180.0
        ]

    def _pins(self) -> list[dict[str, F64]]:
        return [
            {
                "X": np.full(2, x),
                "Y": np.full(2, y),
                "Z": np.zeros(2),
                "tool": np.array([0.0, length]),
            }
            for x, length in ((100.0, 250.0), (350.0, 180.0), (600.0, 90.0))
            for y in (100.0, 450.0, 800.0)
        ]

    def draw(self, drawing: Drawing) -> None:
        """The volume before and after, and a scale of the exaggeration."""
        strokes = self.strokes()
        together = {name: np.concatenate([rows[name] for rows in strokes]) for name in strokes[0]}
        ends = np.cumsum([len(next(iter(rows.values()))) for rows in strokes])[:-1]
        at = self.conditions(together, {})
        chain = Chain(self.machine, at)
        before = np.split(chain.point, ends)
        after = np.split(chain.to_workpiece(self.displaced(at)), ends)
        other = []
        if self.scene.versus is not None:
            second = self.conditions(together, self.scene.versus)
            other = np.split(chain.to_workpiece(self.displaced(second)), ends)
        if self.scene.look == "rays":
            before, after = self._rays()
        points = np.concatenate(before)
        low, high = points.min(axis=0), points.max(axis=0)
        frame = self._box(low, high) if self.scene.look in _BOXED else []
        if frame:
            corners = np.concatenate(frame)
            low, high = corners.min(axis=0), corners.max(axis=0)
        diagonal = float(np.linalg.norm(high - low))
        largest = max(float(np.linalg.norm(d, axis=1).max()) for d in (*after, *other))
        factor = _round(_REACH * diagonal / largest)
        view = _View(low, high)
        drawing.paths((view(line) for line in frame), "zero")
        drawing.paths((_straightened(view(line)) for line in before), "before")
        for css, moved in zip(_LOOKS, (after, other), strict=True):
            if moved:
                lines = [b + factor * d for b, d in zip(before, moved, strict=True)]
                drawing.paths((_straightened(view(line)) for line in lines), css)
                if self.scene.look in ("line", "plate"):
                    for x, y in view(np.concatenate(lines)) if len(lines) == 1 else ():
                        drawing.dot(x, y, 2.2, "dot")
        if self.scene.look == "rays":
            x, y = view(before[0][:1])[0]
            drawing.dot(x, y, 4, "base")
            drawing.text(x + 8, y + 4, "base")
        view.axes(drawing)
        words = f"exaggerated {factor:,.0f} times; largest {1000 * largest:.3g} µm"
        drawing.text(12, 20, words.replace(",", " "), "small")

    def _box(self, low: F64, high: F64) -> list[F64]:
        travel = [self.machine.axis(a).travel for a in "XYZ"]
        corners = np.array([[x, y, z] for x in travel[0] for y in travel[1] for z in travel[2]])
        pairs = [
            (i, j) for i in range(8) for j in range(i) if np.sum(corners[i] != corners[j]) == 1
        ]
        return [corners[[i, j]] for i, j in pairs]

    def _rays(self) -> tuple[list[F64], list[F64]]:
        base = np.array([50.0, 60.0, -360.0])
        ends = [[650, 100, -50], [600, 500, -60], [350, 850, -40], [100, 700, -100], [300, 400, 0]]
        bias = self.term.coefficients(self.machine)[0]
        before = [np.array([base, end]) for end in ends]
        ways = [(b[1] - b[0]) / np.linalg.norm(b[1] - b[0]) for b in before]
        return before, [np.array([np.zeros(3), bias * way]) for way in ways]


class _View:
    """An oblique look at a box from the front right, above."""

    def __init__(self, low: F64, high: F64) -> None:
        turn, lift = math.radians(-32.0), math.radians(24.0)
        c, s = math.cos(turn), math.sin(turn)
        self._matrix = np.array(
            [[c, -s, 0.0], [-s * math.sin(lift), -c * math.sin(lift), -math.cos(lift)]]
        )
        self._middle = 0.5 * (low + high)
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1])
                            for z in (low[2], high[2])])  # fmt: skip
        flat = (corners - self._middle) @ self._matrix.T
        spread = np.ptp(flat, axis=0)
        self._scale = min(0.80 * 400 / spread[0], 0.76 * 265 / spread[1])
        self._place = np.array([205.0, 165.0]) - 0.5 * self._scale * (flat.max(0) + flat.min(0))
        self._low = low

    def __call__(self, points: F64) -> F64:
        """Points (n, 3) in mm → (n, 2) in pixels."""
        return np.asarray((points - self._middle) @ self._matrix.T * self._scale + self._place)

    def axes(self, drawing: Drawing) -> None:
        """A small cross of axes at the lower left."""
        origin = np.array([34.0, HEIGHT - 52.0])
        for letter, unit in zip("XYZ", np.eye(3), strict=True):
            tip = origin + 26.0 * (self._matrix @ unit)
            drawing.path([origin, tip], "rule")
            x, y = origin + 35.0 * (self._matrix @ unit)
            drawing.text(x, y + 4, letter, "small", "middle")


def _inside(position: float, grid: F64) -> bool:
    return bool(grid[0] < position < grid[-1])


def _straightened(line: F64) -> F64:
    """A polyline (n, 2) without the points that lie on the line between those kept, to 0.1 px."""
    kept = [0]
    while kept[-1] < len(line) - 1:
        start, end = kept[-1], kept[-1] + 1
        while end + 1 < len(line) and _off(line[start : end + 2]) < 0.1:
            end += 1
        kept.append(end)
    return line[kept]


def _off(line: F64) -> float:
    along = line[-1] - line[0]
    length = float(np.hypot(*along))
    out = line[1:-1] - line[0]
    if length < 1e-9:
        return float(np.hypot(*out.T).max(initial=0.0))
    return float(np.abs(out[:, 0] * along[1] - out[:, 1] * along[0]).max(initial=0.0)) / length


def _round(value: float) -> float:
    """The nearest 1, 2 or 5 times a power of ten below."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(k for k in (1.0, 2.0, 5.0) if k * power <= value * (1 + 1e-9)) * power


# --- the diagram ----------------------------------------------------------------------------

_LEFT, _RIGHT, _TOP, _BOTTOM = 475.0, 735.0, 46.0, 252.0


def _diagram(drawing: Drawing, stage: _Stage) -> None:
    curve = stage.scene.curve
    x = np.linspace(*curve.span, 121)
    lines = {words: stage_values(stage, x, changed) for words, changed in curve.lines.items()}
    what, unit = str(stage.error_motion), "µrad" if stage.error_motion.rotation else "µm"
    if stage.error_motion.place == INSTRUMENT:
        what = "value"
    if stage.scene.look == "pins":
        what, unit = "dX", "µm"
    shown = np.concatenate([*lines.values(), [0.0]])
    low, high = float(shown.min()), float(shown.max())
    pad = 0.08 * (high - low or 1.0)
    low, high = low - pad, high + pad

    def at(px: F64, py: F64) -> F64:
        across = _LEFT + (_RIGHT - _LEFT) * (px - curve.span[0]) / (curve.span[1] - curve.span[0])
        up = _BOTTOM - (_BOTTOM - _TOP) * (py - low) / (high - low)
        return np.stack(np.broadcast_arrays(across, up), axis=-1)

    drawing.path([(_LEFT, _TOP), (_LEFT, _BOTTOM), (_RIGHT, _BOTTOM)], "rule")
    drawing.path(at(np.array(curve.span), np.zeros(2)), "zero")
    for tick in _ticks(low, high):
        px, py = at(np.array(curve.span[0]), np.array(tick))
        drawing.text(px - 6, py + 4, f"{tick:g}", "small", "end")
    for tick in _ticks(*curve.span):
        px, _ = at(np.array(tick), np.array(low))
        drawing.text(px, _BOTTOM + 16, f"{tick:g}", "small", "middle")
    for css, (words, y) in zip(_LOOKS, lines.items(), strict=False):
        drawing.path(_straightened(at(x, y)), css)
        if words:
            place = list(lines).index(words)
            drawing.path([(_LEFT + 30 + 120 * place, 16), (_LEFT + 48 + 120 * place, 16)], css)
            drawing.text(_LEFT + 53 + 120 * place, 20, words, "small")
    drawing.text(_LEFT - 34, 36, f"{what} in {unit}")
    drawing.text(0.5 * (_LEFT + _RIGHT), _BOTTOM + 36, curve.words, "", "middle")


def stage_values(stage: _Stage, x: F64, changed: Mapping[str, float]) -> F64:
    """The diagram's ordinate, µm or µrad."""
    curve, scene = stage.scene.curve, stage.scene
    if scene.look == "pins":
        return 1000.0 * scene.values["angle"] * x
    if scene.look == "rays":
        return np.full(len(x), 1000.0 * scene.values["bias"])
    rows = {
        curve.over: x
        * {"t": 3600.0, "A": math.pi / 180.0, "C": math.pi / 180.0}.get(curve.over, 1.0)
    }
    if scene.look in ("line", "plate") and curve.over == "t":
        rows["X"] = np.linspace(*stage.machine.axis("X").travel, len(x))
        rows |= stage._weather(len(x))
    factor = 1e6 if stage.error_motion.rotation else 1e3
    return factor * stage.motion(stage.conditions(rows, changed))


def _ticks(low: float, high: float) -> Iterable[float]:
    step = _round((high - low) / 2.5)
    return [float(k * step) for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
