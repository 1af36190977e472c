"""The shop: how temperatures, speed and load wander through a working day; seeded, smooth.

Nothing here knows what an effect is. Signals are sums of slow sinusoids of irregular periods,
ramps and bodies that follow the air with their own time constants, plus a thermometer's noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """One recorded signal: name, unit, role, axis, and how it is made."""

    name: str
    unit: str
    role: str
    axis: str | None
    start: float
    swing: float
    follow: float
    heat: float = 0.0


def sensors(axes: tuple[str, ...]) -> list[Sensor]:
    """The thermometers of a machine with these linear axes, and a feed and load signal."""
    column = axes[-1]
    found = [Sensor("T_amb", "degC", "ambient", None, 20.3, 0.9, 0.0)]
    for i, axis in enumerate(axes):
        found.append(
            Sensor(
                f"T_{axis.lower()}", "degC", "scale", axis, 19.8 + 0.2 * i, 0.0, 2400.0 + 900 * i
            )
        )
    found.append(Sensor("T_col_front", "degC", "structure", column, 20.1, 0.35, 3600.0))
    found.append(Sensor("T_col_rear", "degC", "structure", column, 20.0, 0.3, 6500.0))
    found.append(Sensor("T_spindle", "degC", "spindle", None, 23.0, 0.6, 1500.0, heat=2.0))
    return found


def wander(rng: np.random.Generator, time: F64, swing: float) -> F64:
    """A smooth irregular course of about ±swing over the campaign, shape of `time` (s)."""
    span = float(time[-1] - time[0])
    total = np.zeros_like(time)
    for weight, cycles in (
        (1.0, rng.uniform(0.4, 0.9)),
        (0.5, rng.uniform(1.2, 2.5)),
        (0.25, rng.uniform(3.0, 6.0)),
    ):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        total += weight * np.sin(2.0 * np.pi * cycles * time / span + phase)
    return swing * total / 1.2


def follow(time: F64, course: F64, tau: float) -> F64:
    """A body behind the air: dy/dt = (x − y)/τ by small Euler steps on an even clock."""
    if tau <= 0.0:
        return course
    y = np.empty_like(course)
    y[0] = course[0]
    for i in range(1, len(course)):
        dt = time[i] - time[i - 1]
        y[i] = y[i - 1] + (course[i - 1] - y[i - 1]) * (1.0 - np.exp(-dt / tau))
    return y


def weather(rng: np.random.Generator, clock: F64) -> tuple[F64, F64]:
    """Pressure of the air while a front passes, hPa: true, and as a barometer records it."""
    course = 1008.0 + wander(rng, clock, 5.0) + rng.uniform(-6.0, 6.0) * clock / clock[-1]
    return course, course + rng.normal(0.0, 0.05, len(clock))


def record(
    rng: np.random.Generator, axes: tuple[str, ...], duration: float
) -> tuple[F64, dict[str, F64], dict[str, F64]]:
    """Courses of all signals over a campaign.

    Returns
    -------
    clock
        Even clock, s, a step of 10 s.
    true, recorded
        Name → course; `recorded` has the thermometers' noise (5 mK).
    """
    clock = np.arange(0.0, duration + 10.0, 10.0)
    air = wander(rng, clock, 0.9) + rng.uniform(0.5, 2.0) * clock / duration
    true: dict[str, F64] = {}
    for sensor in sensors(axes):
        own = wander(rng, clock, sensor.swing) if sensor.name != "T_amb" else 0.0
        course = sensor.start + follow(clock, air, sensor.follow) + own
        if sensor.heat:
            course = course + sensor.heat * np.exp(-clock / 9000.0) * (
                1.0 + 0.3 * np.sin(2.0 * np.pi * clock / rng.uniform(5000.0, 9000.0))
            )
        true[sensor.name] = course
    feed = 500.0 + 2500.0 * rng.random(int(duration // 300) + 2)
    true["feed"] = feed[(clock // 300).astype(int)]
    load = rng.choice([0.0, 120.0, 300.0], size=int(duration // 2400) + 2)
    true["load"] = load[(clock // 2400).astype(int)]
    recorded = {
        name: course + (rng.normal(0.0, 0.005, len(clock)) if name.startswith("T_") else 0.0)
        for name, course in true.items()
    }
    return clock, true, recorded
