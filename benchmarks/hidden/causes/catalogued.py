"""Hidden causes for which the catalogue has an effect: one for each of its kinds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.hidden.causes.cause import F64, POINT, READING, Cause, State, lagged, six


def catalogue(
    axes: Sequence[str], travels: Mapping[str, tuple[float, float]], rng: np.random.Generator
) -> dict[str, Cause]:
    """One cause for each kind of the catalogue that a machine with three linear axes can have."""
    order = list(axes)
    first, last = order[0], order[-1]
    number = {a: "XYZ".index(a) for a in axes}
    centre = {a: 0.5 * sum(travels[a]) for a in axes}
    half = {a: 0.5 * (travels[a][1] - travels[a][0]) for a in axes}
    a = order[int(rng.integers(3))]
    about = "XYZ"[int(rng.integers(3))]
    turn = 3 + "XYZ".index(about)
    other = order[(order.index(a) + 1) % 3]
    along = number[a]
    d = "XYZ"[int(rng.integers(3))]
    dk = "XYZ".index(d)
    tau = float(rng.uniform(1500.0, 6000.0))
    column = ["T_col_front", "T_col_rear"]
    period = float(rng.uniform(30.0, 90.0))
    moment = float(rng.uniform(8000.0, 18000.0))
    # only a rotation with a lever shows in displacements; every structure's first axis has some
    tilted = first
    found = [
        Cause(
            "backlash",
            a,
            lambda s: six(s, along, 0.5 * np.asarray(s[f"{a}_dir"])),
            (("backlash", {"axis": a}),),
        ),
        Cause(
            "reversal_angle",
            tilted,
            lambda s: six(s, turn, 0.5 * np.asarray(s[f"{tilted}_dir"])),
            (("reversal_angle", {"axis": tilted, "about": about}),),
            size=3e-6,
        ),
        Cause(
            "thermal_tilt",
            tilted,
            lambda s: six(s, turn, s[column[0]] - s[column[1]]),
            (("thermal_tilt", {"axis": tilted, "about": about, "signals": column}),),
            size=3e-6,
        ),
        Cause(
            "thermal_bending",
            tilted,
            lambda s: six(s, turn, (s[column[0]] - s[column[1]]) * s[tilted] / half[tilted]),
            (("thermal_bending", {"axis": tilted, "about": about, "signals": column}),),
            size=3e-6,
        ),
        Cause(
            "thermal_offset",
            POINT,
            lambda s: six(s, 2, s["T_spindle"] - 20.0),
            (("thermal_offset", {"direction": "Z", "signal": "T_spindle"}),),
        ),
        Cause(
            "thermal_offset lagged",
            POINT,
            lambda s: six(s, dk, lagged(s, "T_amb", 4000.0) - 20.0),
            (
                ("thermal_offset", {"direction": d, "signal": "T_amb", "tau": "fit"}),
                ("thermal_offset", {"direction": d, "signal": "T_amb"}),
            ),
        ),
        Cause(
            "scale_expansion",
            a,
            lambda s: six(s, along, s[a] / half[a] * (s["T_amb"] - 20.0)),
            (("scale_expansion", {"axis": a, "signals": ["T_amb"]}),),
        ),
        Cause(
            "warm_up",
            POINT,
            lambda s: six(s, dk, 1.0 - np.exp(-np.asarray(s["t"]) / tau)),
            (("warm_up", {"direction": d}),),
        ),
        Cause(
            "drift",
            POINT,
            lambda s: six(s, dk, np.asarray(s["t"]) / 20000.0),
            (("drift", {"direction": d}),),
        ),
        Cause(
            "event",
            POINT,
            lambda s: six(s, dk, (np.asarray(s["t"]) > moment) * 1.0),
            (("event", {"direction": d}),),
        ),
        Cause(
            "cyclic",
            a,
            lambda s: six(s, along, np.sin(2.0 * np.pi * s[a] / period + 0.7)),
            (("cyclic", {"axis": a}),),
        ),
        Cause(
            "cross_angular",
            tilted,
            lambda s: six(s, turn, (s[last] - centre[last]) / half[last]),
            (("cross_angular", {"axis": tilted, "about": about, "by": last}),),
            size=5e-6,
        ),
        Cause(
            "local_defect",
            a,
            lambda s: six(
                s,
                number[other],
                np.exp(-0.5 * ((s[a] - centre[a] - 0.3 * half[a]) / (0.09 * half[a])) ** 2),
            ),
            (("local_defect", {"axis": a, "error": f"E_{other}{a}"}),),
        ),
        Cause(
            "load_bending",
            tilted,
            lambda s: six(s, turn, s["load"] / 300.0),
            (("load_bending", {"axis": tilted, "about": about, "signal": "load"}),),
            size=5e-6,
        ),
        Cause(
            "feed_lag",
            a,
            lambda s: six(s, along, s["feed"] / 3000.0 * np.asarray(s[f"{a}_dir"])),
            (("feed_lag", {"axis": a, "signal": "feed"}),),
        ),
        Cause(
            "instrument_drift",
            READING,
            lambda s: _in(s, "c1_diag0") * (np.asarray(s["t"]) - _start(s, "c1_diag0")) / 300.0,
            (
                ("instrument_drift", {"setup": "c1_diag0"}),
                ("setup_slope", {"setup": "c1_diag0"}),
            ),
        ),
        Cause(
            "cosine",
            READING,
            lambda s: -_in(s, "c0_diag6") * _along(s, "c0_diag6"),
            (("cosine", {"setup": "c0_diag6"}),),
        ),
    ]
    return {c.name: c for c in found}


def _in(state: State, setup: str) -> F64:
    return np.asarray(np.asarray(state["setup"]) == setup, dtype=np.float64)


def _start(state: State, setup: str) -> float:
    rows = np.asarray(state["setup"]) == setup
    return float(np.asarray(state["t"])[rows].min(initial=np.inf)) if rows.any() else 0.0


def _along(state: State, setup: str) -> F64:
    """Path from the set-up's first point, parts of its length; 0 where it was not measured."""
    q = np.stack([state["X"], state["Y"], state["Z"]], axis=1)
    rows = np.asarray(state["setup"]) == setup
    if not rows.any():
        return np.zeros(len(q))
    way = np.linalg.norm(q - q[rows][0], axis=1)
    return np.asarray(way / way[rows].max())
