"""A machine tool as bodies that store heat and pass it on: an energy balance for each.

``C_i dT_i/dt = Σ_j G_ij (T_j − T_i) + H_i (T_air − T_i) + F_i·on(t)·(T_coolant − T_i) + P_i(t)``

A network has as many time constants as bodies, and none of them belongs to one body alone. The
balance is linear, so what each source of heat does is followed apart from the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

REFERENCE = 20.0
"""Temperature at which the machine is as it was drawn, °C."""

BODIES = ("bearing", "head", "front", "rear", "bed", "table", "scale_x", "scale_y")
SOURCES = ("air", "coolant", "spindle", "sun", "pump")

_HEAT = {
    "bearing": 4e3,
    "head": 8e4,
    "front": 2.2e5,
    "rear": 2.6e5,
    "bed": 9e5,
    "table": 1.2e5,
    "scale_x": 6e3,
    "scale_y": 6e3,
}
"""Heat capacity, J/K: the bearing follows within minutes, the bed takes half a day."""

_TO_AIR = {
    "bearing": 1.0,
    "head": 20.0,
    "front": 25.0,
    "rear": 28.0,
    "bed": 35.0,
    "table": 20.0,
    "scale_x": 4.0,
    "scale_y": 4.0,
}
"""Conductance to the air, W/K."""

_BETWEEN = {
    ("bearing", "head"): 12.0,
    ("head", "front"): 15.0,
    ("front", "rear"): 30.0,
    ("rear", "bed"): 20.0,
    ("table", "bed"): 15.0,
    ("scale_x", "table"): 1.0,
    ("scale_y", "bed"): 1.0,
}
"""Conductance from body to body, W/K."""

_TO_COOLANT = {"table": 70.0, "bed": 20.0}
"""Conductance to the coolant while it flows, W/K."""


@dataclass(frozen=True, eq=False)
class Weather:
    """What goes on around and in a machine, at even steps of time.

    Attributes
    ----------
    step
        Seconds from one value to the next.
    air, coolant
        Temperatures, °C, shape (n,).
    flowing
        Whether coolant flows, shape (n,).
    spindle, sun, pump
        Heat in W, shape (n,): of the spindle's bearings and motor, of the sun on the column's
        front, of the hydraulics at the bed.
    """

    step: float
    air: F64
    coolant: F64
    flowing: NDArray[np.bool_]
    spindle: F64
    sun: F64
    pump: F64


def warmth(weather: Weather) -> dict[str, F64]:
    """How far each body is above 20 °C, source by source; both shapes (n, sources).

    At the first step every body is as warm as the air.
    """
    capacity = np.array([_HEAT[b] for b in BODIES])
    matrices = {flowing: _matrix(flowing) for flowing in (False, True)}
    half = 0.5 * weather.step
    eye = np.eye(len(BODIES))
    # the middle of each step (Crank and Nicolson): exact to the square of the step
    onward = {
        flowing: (np.linalg.inv(eye - half * a), eye + half * a) for flowing, a in matrices.items()
    }
    gained = _gained(weather) / capacity[:, None, None]
    state = np.zeros((len(BODIES), len(SOURCES)))
    state[:, 0] = weather.air[0] - REFERENCE
    out = np.empty((len(weather.air), *state.shape))
    out[0] = state
    for k in range(1, len(out)):
        inverse, forward = onward[bool(weather.flowing[k])]
        mean = 0.5 * (gained[..., k - 1] + gained[..., k])
        state = inverse @ (forward @ state + weather.step * mean)
        out[k] = state
    return {body: out[:, i] for i, body in enumerate(BODIES)}


def _matrix(flowing: bool) -> F64:
    """What the bodies' own temperatures do to their change, 1/s."""
    a = np.zeros((len(BODIES), len(BODIES)))
    for body, conductance in _TO_AIR.items():
        a[BODIES.index(body), BODIES.index(body)] -= conductance
    for (one, other), conductance in _BETWEEN.items():
        i, j = BODIES.index(one), BODIES.index(other)
        a[[i, j], [i, j]] -= conductance
        a[i, j] += conductance
        a[j, i] += conductance
    for body, conductance in _TO_COOLANT.items():
        a[BODIES.index(body), BODIES.index(body)] -= conductance * flowing
    return a / np.array([_HEAT[b] for b in BODIES])[:, None]


def _gained(weather: Weather) -> F64:
    """Heat that comes from outside, W, shape (bodies, sources, n)."""
    gained = np.zeros((len(BODIES), len(SOURCES), len(weather.air)))
    for body, conductance in _TO_AIR.items():
        gained[BODIES.index(body), 0] += conductance * (weather.air - REFERENCE)
    for body, conductance in _TO_COOLANT.items():
        flow = conductance * weather.flowing * (weather.coolant - REFERENCE)
        gained[BODIES.index(body), 1] += flow
    gained[BODIES.index("bearing"), 2] += 0.75 * weather.spindle
    gained[BODIES.index("head"), 2] += 0.25 * weather.spindle
    gained[BODIES.index("front"), 3] += weather.sun
    gained[BODIES.index("bed"), 4] += weather.pump
    return gained


def of_sources(excess: Mapping[str, F64], body: str) -> dict[str, F64]:
    """What each source does to one body, K, shape (n,)."""
    return {source: excess[body][:, i] for i, source in enumerate(SOURCES)}
