"""A small fitted machine and its checks, made of numbers: no file, no simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model

MODEL = """
format = "abbe-model/1"
[machine]
name = "Checked"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 500.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[machine.signals.T_x]
unit = "degC"
role = "scale"
axis = "X"
[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
[effects.parameters.alpha]
value = 1.0e-5
sd = 1.0e-6
unit = "1/K"
[[effects]]
kind = "squareness"
axes = ["Y", "X"]
[effects.parameters.angle]
value = 20e-6
sd = 5e-6
unit = "rad"
"""
ALPHA, ALPHA_SD, ANGLE, ANGLE_SD = 1e-5, 1e-6, 20e-6, 5e-6
DAY = 86400.0


def checked_model(*, left_over: float | None = None, covariance: bool = True) -> Model:
    """A bridge whose X scale expands and whose X stands askew on Y; µm that its fit left over."""
    model = parse_model(TomlSource(MODEL))
    fit = {} if left_over is None else {"rms": left_over, "date": "2026-01-05T08:00:00+00:00"}
    known = np.diag([ALPHA_SD**2, ANGLE_SD**2]) if covariance else None
    return replace(model, covariance=known, fit=fit)


def checks(
    rows: Sequence[Mapping[str, object]], *, free: Mapping[str, tuple[str, ...]] | None = None
) -> Campaign:
    """Rows of check measurements: time, setup, X, Y, Z, u, value and sd (µm), T_x, kind."""
    n = len(rows)

    def column(name: str, default: float = 0.0) -> np.ndarray:
        return np.array([float(r.get(name, default)) for r in rows])  # type: ignore[arg-type]

    setup = np.array([str(r.get("setup", "place")) for r in rows])
    kind = np.array([int(r.get("kind", Kind.DISPLACEMENT)) for r in rows], dtype=np.int8)  # type: ignore[call-overload]
    unit = np.where(kind == Kind.ROTATION, 1e-6, 1e-3)
    conditions = Conditions(
        positions={a: column(a) for a in "YXZ"},
        tool=np.zeros((n, 3)),
        time=column("time"),
        signals={"T_x": column("T_x", 20.0)},
        setup=setup,
        u=np.array([r.get("u", (1.0, 0.0, 0.0)) for r in rows], dtype=float),
    )
    names = list(dict.fromkeys(setup.tolist()))
    return Campaign(
        "checks.csv",
        conditions,
        kind,
        column("value") * unit,
        column("sd", 1.0) * unit,
        np.full(n, ""),
        np.full(n, ""),
        np.arange(n) + 2,
        setups={s: Setup(s, (free or {}).get(s, ())) for s in names},
    )
