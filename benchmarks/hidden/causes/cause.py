"""A hidden cause: what the simulated machine does that the user's model does not know.

Each is written from physics for the exact chain, in mm, rad, °C and s, with no view of the effects'
code: a function of the state that gives six error motions of one place, or a change of the measured
value. Amplitudes are unit-free here; a scenario scales them to a multiple of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
State = Mapping[str, Any]

POINT = "point"
READING = "reading"
SENSOR = "sensor"


@dataclass(frozen=True)
class Cause:
    """One hidden cause.

    Attributes
    ----------
    name
        For the table.
    place
        An axis, `POINT` (translation of the functional point), `READING` (the instrument), or
        `SENSOR` (what the thermometer in `depends` reads).
    motion
        State → six error motions of the place, (n, 6), at amplitude 1; for `READING` (n,), mm; for
        `SENSOR` (n,), K too much.
    answers
        (kind, where-keys) that name it rightly; empty for what is in no catalogue.
    depends
        For what is in no catalogue: the recorded quantities that it depends on.
    formula
        For what is in no catalogue: error motion and terms by which a ``formula`` says it.
    size
        Amplitude that makes an effect of about a micrometre, for scaling.
    omits
        (kind, where-keys) of an effect that the user's model lacks.
    """

    name: str
    place: str
    motion: Callable[[State], F64]
    answers: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    depends: tuple[str, ...] = ()
    size: float = 1e-3
    omits: tuple[str, Mapping[str, Any]] | None = None
    formula: tuple[str, tuple[str, ...]] | None = None


def six(state: State, component: int, value: F64) -> F64:
    """Six error motions with one component set, shape (n, 6)."""
    out = np.zeros((len(np.asarray(state["t"])), 6))
    out[:, component] = value
    return out


def lagged(state: State, name: str, tau: float) -> F64:
    """A signal's true course behind a body of time constant tau, at the rows' times."""
    clock, course = state["clock"], state["courses"][name]
    y = np.empty_like(course)
    y[0] = course[0]
    for i in range(1, len(course)):
        dt = clock[i] - clock[i - 1]
        y[i] = y[i - 1] + (course[i - 1] - y[i - 1]) * (1.0 - np.exp(-dt / tau))
    return np.interp(state["t"], clock, y)
