"""Days of a scenario as campaign files, and what is known of them beyond what they say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.thermal import machine
from benchmarks.thermal.bodies import BODIES, REFERENCE, SOURCES, of_sources, warmth
from benchmarks.thermal.scenario import Run, Scenario, Sensor
from benchmarks.thermal.weather import DAY, FIRST, LAST, STEP, Week, week

F64 = NDArray[np.float64]

BEFORE, SEEN, UNSEEN = 2, 3, 2
"""Days before the first reading, days to learn from, later days to judge by."""

QUICK, SLOW = 0.3, 0.5
"""Noise of the probes, µm: of each reading apart, and that stays for some minutes."""
SD = float(np.hypot(QUICK, SLOW))
"""What the campaigns say of their uncertainty, µm."""
STAYS = (1.0, 30.0)
"""The slow noise's memory, minutes: least and greatest."""

_OF_A_PROBE = 6.0
"""Seconds from place to place within a round."""


@dataclass(frozen=True, eq=False)
class Days:
    """The files of a scenario, and its truth.

    Attributes
    ----------
    model
        A machine file without effects.
    seen, unseen
        One campaign file a day, as text.
    floor
        RMS of the unseen days' noise, each set-up's mean left out, µm.
    moved
        Source → how far it moved the tool in X, Y and Z on the days that are seen, each set-up's
        mean left out, µm rms.
    read
        Sensor → source → how far the source moved its reading on these days, K rms.
    """

    model: str
    seen: tuple[str, ...]
    unseen: tuple[str, ...]
    floor: float
    moved: Mapping[str, F64]
    read: Mapping[str, Mapping[str, float]]


def make(run: Run) -> Days:
    """Simulate the days of a run."""
    rng = np.random.default_rng(run.seed)
    scenario = run.scenario
    around = week(scenario.shop, BEFORE + SEEN + UNSEEN, rng)
    excess = warmth(around.weather)
    offsets = {s.name: rng.normal(0.0, 0.15) for s in scenario.sensors}
    stays = float(np.exp(rng.uniform(*np.log(STAYS)))) * 60.0
    days = [
        _day(scenario, around, excess, offsets, stays, BEFORE + k, rng)
        for k in range(SEEN + UNSEEN)
    ]
    seen, unseen = days[:SEEN], days[SEEN:]
    noise = np.concatenate([d.noise for d in unseen])
    return Days(
        _model_text(scenario),
        tuple(d.text for d in seen),
        tuple(d.text for d in unseen),
        float(np.sqrt(np.mean(noise**2))),
        {s: _rms([d.moved[s] for d in seen]) for s in SOURCES},
        {
            sensor.name: {s: float(_rms([d.read[sensor.name][s] for d in seen])) for s in SOURCES}
            for sensor in scenario.sensors
        }
        | ({"n_spindle": dict.fromkeys(SOURCES, 0.0) | {"spindle": 1.0}} if scenario.speed else {}),
    )


def write(texts: tuple[str, ...], folder: Path, name: str) -> list[Path]:
    """Write days into a folder, each to a file of its own."""
    paths = []
    for k, text in enumerate(texts):
        path = folder / f"{name}-{k + 1}.csv"
        path.write_text(text, encoding="utf-8")
        paths.append(path)
    return paths


@dataclass(frozen=True, eq=False)
class _Day:
    text: str
    noise: F64
    moved: Mapping[str, F64]
    read: Mapping[str, Mapping[str, F64]]


def _rms(parts: list[F64]) -> F64:
    """Root mean square over the rows of several days, each day's mean left out."""
    centred = np.concatenate([p - p.mean(axis=0) for p in parts])
    return np.asarray(np.sqrt(np.mean(centred**2, axis=0)))


def _day(
    scenario: Scenario,
    around: Week,
    excess: Mapping[str, F64],
    offsets: Mapping[str, float],
    stays: float,
    day: int,
    rng: np.random.Generator,
) -> _Day:
    starts = np.arange(day * DAY + FIRST, day * DAY + LAST, scenario.every)
    points = scenario.points
    time = (starts[:, None] + _OF_A_PROBE * np.arange(len(points))).reshape(-1)
    at = np.tile(np.array([place for place, _ in points]), (len(starts), 1))
    index = np.clip(np.round(time / STEP).astype(int), 0, len(around.time) - 1)
    by_source = {
        source: {b: of_sources(excess, b)[source][index] for b in BODIES} for source in SOURCES
    }
    whole = {b: excess[b][index].sum(axis=1) for b in BODIES}
    slow = _slow(len(starts), scenario.every, stays, rng).repeat(len(points), axis=0)
    noise = slow + rng.normal(0.0, QUICK, (len(time), 3))
    value = noise + (1e3 * machine.error(whole, at) if scenario.warms else 0.0)
    readings = {s.name: _reading(s, around, whole, index, offsets, rng) for s in scenario.sensors}
    text, used = _text(scenario, around, time, at, value, readings, index, len(starts))
    moved = {
        source: 1e3 * machine.error(part, at)[: len(time)] * scenario.warms
        for source, part in by_source.items()
    }
    read = {s.name: _sources_of(s, around, by_source, index) for s in scenario.sensors}
    left = np.concatenate([noise[m, k] - noise[m, k].mean() for k, m in enumerate(used) if m.any()])
    return _Day(text, left, moved, read)


def _slow(rounds: int, every: float, stays: float, rng: np.random.Generator) -> F64:
    """Noise that stays for a while, in three directions, µm, shape (rounds, 3)."""
    keep = np.exp(-every / stays)
    out = np.empty((rounds, 3))
    state = rng.normal(0.0, SLOW, 3)
    for k in range(rounds):
        out[k] = state
        state = keep * state + rng.normal(0.0, SLOW * np.sqrt(1.0 - keep**2), 3)
    return out


def _reading(
    sensor: Sensor,
    around: Week,
    whole: Mapping[str, F64],
    index: NDArray[np.int64],
    offsets: Mapping[str, float],
    rng: np.random.Generator,
) -> F64:
    air = around.weather.air[index]
    body = {"air": air, "coolant": around.weather.coolant[index]}.get(sensor.body)
    if body is None:
        body = REFERENCE + whole[sensor.body]
    loose = sensor.loose
    read = (1.0 - loose) * body + loose * air
    if sensor.body == "air":
        # under the roof it is warmer, and later
        late = np.interp(index * STEP - 2400.0, around.time, around.weather.air)
        read = (1.0 - loose) * air + loose * (late + 2.0)
    read = read + offsets[sensor.name] + rng.normal(0.0, 0.02, len(read))
    return np.asarray(np.round(read / 0.05) * 0.05)


def _sources_of(
    sensor: Sensor,
    around: Week,
    by_source: Mapping[str, Mapping[str, F64]],
    index: NDArray[np.int64],
) -> dict[str, F64]:
    """What each source does to a reading, K, (n,)."""
    air = around.weather.air[index] - REFERENCE
    nothing = np.zeros(len(index))
    if sensor.body in ("air", "coolant"):
        found = dict.fromkeys(SOURCES, nothing) | {"air": air}
        if sensor.body == "coolant":
            found["coolant"] = around.weather.coolant[index] - around.weather.air[index]
    else:
        found = {s: (1.0 - sensor.loose) * by_source[s][sensor.body] for s in SOURCES}
        found["air"] = found["air"] + sensor.loose * air
    return found


def _model_text(scenario: Scenario) -> str:
    lines = ['format = "abbe-model/1"', "[machine]", 'name = "mill"']
    lines += ["structure = \"w X' Y' b Z t\"", "reference_temperature = 20.0"]
    for axis, (low, high) in machine.TRAVEL.items():
        lines += [f"[machine.axes.{axis}]", f"travel = [{low}, {high}]"]
    for s in scenario.sensors:
        lines += [f"[machine.signals.{s.name}]", 'unit = "degC"', f'role = "{s.role}"']
        lines += [f'axis = "{s.axis}"'] if s.axis else []
    if scenario.speed:
        lines += ["[machine.signals.n_spindle]", 'unit = "rpm"', 'role = "speed"']
    return "\n".join(lines) + "\n"


def _text(
    scenario: Scenario,
    around: Week,
    time: F64,
    at: F64,
    value: F64,
    readings: Mapping[str, F64],
    index: NDArray[np.int64],
    rounds: int,
) -> tuple[str, list[NDArray[np.bool_]]]:
    """A day's file, read against each direction's first reading; and the rows of each direction."""
    which = np.tile(np.arange(len(scenario.points)), rounds)
    used = [
        np.isin(which, [i for i, (_, d) in enumerate(scenario.points) if letter in d])
        for letter in "XYZ"
    ]
    speed = {"n_spindle": around.speed[index]} if scenario.speed else {}
    signals = {**readings, **speed}
    lines = ['# format = "abbe-campaign/1"', '# instrument = "capacitive probes"']
    for letter, rows in zip("XYZ", used, strict=True):
        lines += [f'# [setups.{letter}]\n# free = ["zero"]'] if rows.any() else []
    lines.append("time,setup,kind,X,Y,Z,ux,uy,uz,value,sd," + ",".join(signals))
    first = [value[int(np.argmax(m)), k] for k, m in enumerate(used)]
    start = time[0]
    for row in range(len(time)):
        place = ",".join(f"{v:.1f}" for v in at[row])
        cells = ",".join(f"{signals[s][row]:.2f}" for s in signals)
        for k, letter in enumerate("XYZ"):
            if used[k][row]:
                u = ",".join("1" if j == k else "0" for j in range(3))
                lines.append(
                    f"{time[row] - start:.1f},{letter},displacement,{place},{u},"
                    f"{value[row, k] - first[k]:.3f},{SD:.3f},{cells}"
                )
    return "\n".join(lines) + "\n", used
