"""Further hidden causes: heat of motion, the measuring itself, what the user's model leaves out.

As in `catalogued`: from physics, for the exact chain, with no view of the effects' code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.hidden.causes.cause import POINT, READING, Cause, State, lagged, six

AIR_PER_K = -0.93e-6
"""Change of the refractive index of air with its temperature, 1/K (20 °C, 1013 hPa)."""


def further(
    axes: Sequence[str], travels: Mapping[str, tuple[float, float]], rng: np.random.Generator
) -> dict[str, Cause]:
    """More causes that the catalogue has, and other ways in which the first ones come."""
    order = list(axes)
    first = order[0]
    a = order[int(rng.integers(3))]
    along = "XYZ".index(a)
    about = "XYZ"[int(rng.integers(3))]
    turn = 3 + "XYZ".index(about)
    low, high = travels[a]
    fixed = low if abs(low) < abs(high) else high
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    d = "XYZ"[int(rng.integers(3))]
    side = order[(order.index(a) + 1) % 3]
    waves = float(rng.uniform(4.5, 5.5))
    found = [
        Cause(
            "screw_heating",
            a,
            lambda s: six(
                s, along, (s[a] - fixed) / (2.0 * half) * lagged(s, "feed", 900.0) / 3000.0
            ),
            (
                ("screw_heating", {"axis": a, "signal": "feed", "tau": "fit"}),
                ("screw_heating", {"axis": a, "signal": "feed"}),
            ),
        ),
        Cause(
            "scale_expansion lagged",
            a,
            lambda s: six(s, along, s[a] / half * (lagged(s, "T_spindle", 2500.0) - 20.0)),
            (
                ("scale_expansion", {"axis": a, "signals": ["T_spindle"], "tau": "fit"}),
                ("scale_expansion", {"axis": a, "signals": ["T_spindle"]}),
                ("screw_heating", {"axis": a, "signal": "T_spindle"}),
            ),
        ),
        Cause(
            "thermal_tilt by one sensor",
            first,
            lambda s: six(s, turn, s["T_spindle"] - 20.0),
            (("thermal_tilt", {"axis": first, "about": about, "signal": "T_spindle"}),),
            size=3e-6,
        ),
        Cause(
            "backlash over the travel",
            a,
            lambda s: six(
                s, along, 0.5 * np.asarray(s[f"{a}_dir"]) * (1.0 + 0.9 * (s[a] - middle) / half)
            ),
            (("backlash", {"axis": a}),),
        ),
        Cause(
            "workpiece_expansion",
            POINT,
            lambda s: _isotropic(s) * ((s["T_amb"] - 20.0) / 1000.0)[:, None],
            (("workpiece_expansion", {"signal": "T_amb"}), ("air_refraction", {})),
        ),
        Cause(
            "air_refraction",
            READING,
            lambda s: _travelled(s) * AIR_PER_K * (s["T_amb"] - 20.0),
            (("air_refraction", {}), ("workpiece_expansion", {"signal": "T_amb"})),
        ),
        Cause(
            "load_bending of a table",
            a,
            lambda s: six(s, "XYZ".index(side), s["load"] / 300.0 * ((s[a] - middle) / half) ** 2),
            (
                (
                    "load_bending",
                    {"axis": a, "direction": side, "signal": "load", "shape": "polynomial:2"},
                ),
                ("load_bending", {"axis": a, "direction": side, "signal": "load"}),
            ),
        ),
        Cause(
            "drift of an axis's zero",
            a,
            lambda s: six(s, along, np.asarray(s["t"]) / 20000.0),
            (("drift", {"axis": a}), ("drift", {"direction": a})),
        ),
        Cause(
            "finer waves of a guideway",
            a,
            lambda s: six(
                s,
                "XYZ".index(side),
                np.sin(2.0 * np.pi * waves * (s[a] - low) / (high - low) + 0.5),
            ),
            (
                ("straightness", {"axis": a, "direction": side, "shape": "spline:16"}),
                ("straightness", {"axis": a, "direction": side}),
            ),
        ),
        Cause(
            "thermal_offset by the scale's own sensor",
            POINT,
            lambda s: six(s, "XYZ".index(d), s["T_col_front"] - 20.0),
            (("thermal_offset", {"direction": d, "signal": "T_col_front"}),),
        ),
    ]
    return {c.name: c for c in found}


def left_out(axes: Sequence[str], rng: np.random.Generator) -> dict[str, Cause]:
    """Effects that the machine has as it is and the user's model lacks; nothing is added to it."""
    a = list(axes)[int(rng.integers(3))]
    first = axes[0]
    others = [c for c in "XYZ" if c != a]
    other = others[int(rng.integers(2))]
    about = [c for c in "XYZ" if c != first][int(rng.integers(2))]
    fine = {"shape": "spline:8"}
    lacking: list[tuple[str, str, dict[str, object], dict[str, object]]] = [
        ("no straightness", "straightness", {"axis": a, "direction": other}, fine),
        ("no angular", "angular", {"axis": first, "about": about}, fine),
        ("no scale_expansion", "scale_expansion", {"axis": a}, {"signals": [f"T_{a.lower()}"]}),
    ]
    return {
        name: Cause(
            name,
            POINT,
            _nothing,
            ((kind, where | detail), (kind, where)),
            size=0.0,
            omits=(kind, where),
        )
        for name, kind, where, detail in lacking
    }


def _nothing(state: State) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return six(state, 0, np.zeros(len(np.asarray(state["t"]))))


def _isotropic(state: State) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """What a workpiece does that is too large: minus the position, (n, 6)."""
    out = np.zeros((len(np.asarray(state["t"])), 6))
    for k, a in enumerate("XYZ"):
        out[:, k] = -np.asarray(state[a])
    return out


def _travelled(state: State) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Distance along the beam since the set-up's first row, mm; 0 for angles."""
    q = np.stack([np.asarray(state[a]) for a in "XYZ"], axis=1)
    setups = np.asarray(state["setup"])
    out = np.zeros(len(q))
    for name in np.unique(setups):
        rows = setups == name
        out[rows] = ((q[rows] - q[rows][0]) * np.asarray(state["u"])[rows]).sum(axis=1)
    return np.asarray(np.where(np.asarray(state["rotation"]), 0.0, out))
