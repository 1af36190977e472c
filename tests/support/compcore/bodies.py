"""A spindle's nose that grows behind its speed, by steps of its heat balance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

F64 = NDArray[np.float64]

MINUTE = 60.0


def body(speed: F64, tau: float, begins: float | None) -> F64:
    """A body that follows a speed, by small steps of its heat balance (Euler, 600 a minute).

    `begins`: how warm it is at first; None: in equilibrium.
    """
    out = np.empty(len(speed))
    state = float(speed[0]) if begins is None else begins
    for i in range(len(speed)):
        out[i] = state
        end = speed[min(i + 1, len(speed) - 1)]
        for k in range(600):
            now = speed[i] + (end - speed[i]) * (k + 0.5) / 600.0
            state += (now - state) * (MINUTE / 600.0) / tau
    return out


def growth(seed: int, truth: list[tuple[float, float, float | None]]) -> tuple[Model, Campaign]:
    """A spindle's nose read every minute for five hours; mm at 10,000 rpm, τ in s, at first."""
    rng = np.random.default_rng(seed)
    speed = np.repeat(rng.choice([0.0, 0.3, 0.6, 1.0], 12), 25)
    grown = sum(k * body(speed, tau, begins) for k, tau, begins in truth)
    text = """
format = "abbe-model/1"
[machine]
name = "mill"
structure = "w b X Y Z t"
[machine.signals.n]
unit = "rpm"
role = "speed"
"""
    text += "".join(f"[machine.axes.{a}]\ntravel = [0.0, 400.0]\n" for a in "XYZ")
    rows = ['# format = "abbe-campaign/1"', '# instrument = "probe"', "# [setups.z]"]
    rows += ['# free = ["zero"]', "time,setup,kind,X,Y,Z,ux,uy,uz,value,n"]
    for i, (n, e) in enumerate(zip(speed, np.broadcast_to(grown, len(speed)), strict=True)):
        value = 1e3 * e + rng.normal(0.0, 0.3)
        rows.append(f"{i * MINUTE},z,displacement,200,200,200,0,0,1,{value:.3f},{1e4 * n:.1f}")
    model = parse_model(TomlSource(text))
    return model, as_campaign("\n".join(rows) + "\n", model)
