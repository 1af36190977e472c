"""Scenarios: which causes are hidden in which machines, how large."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.hidden.campaigns import rotary_plan
from benchmarks.hidden.campaigns.campaign import STRUCTURES, draw
from benchmarks.hidden.campaigns.measuring import NOISE
from benchmarks.hidden.causes import beyond, joined, step_aside
from benchmarks.hidden.causes import rotary as rotary_causes
from benchmarks.hidden.causes.catalogued import catalogue
from benchmarks.hidden.causes.cause import Cause
from benchmarks.hidden.causes.further import further, left_out
from benchmarks.hidden.causes.uncatalogued import uncatalogued
from benchmarks.hidden.scenes import bare, distances, instrument
from benchmarks.hidden.scenes.scene import Scene

MULTIPLES = (3, 6, 12)
EMPTY = 100
PAIRS = (
    ("backlash", "warm_up"),
    ("thermal_tilt", "event"),
    ("cross_angular", "drift"),
    ("scale_expansion", "thermal_offset"),
    ("feed_lag", "thermal_bending"),
    ("backlash", "oscillation in time"),
)
ELSEWHERE: Mapping[str, tuple[str, ...]] = {
    **{name: bare.kinds(words) for name, words in bare.HIDDEN.items()},
    **rotary_causes.HIDDEN,
    **{name: instrument.kinds(words) for name, words in instrument.HIDDEN.items()},
    **dict.fromkeys(distances.HIDDEN, distances.kinds()),
    **dict.fromkeys(beyond.NAMES, tuple(STRUCTURES)),
    **dict.fromkeys(step_aside.NAMES, tuple(STRUCTURES)),
    **dict.fromkeys(joined.NAMES, tuple(STRUCTURES)),
}
"""Causes that need other scenes than the usual ones, or came later → the kinds of scene, taken in
turn."""
EMPTY_ELSEWHERE = (
    *bare.kinds(tuple(bare.MODELLED))[::2],
    *rotary_plan.LAYOUTS,
    *instrument.kinds(instrument.WORDS)[::5],
    *distances.kinds()[::3],
)
"""Other scenes in which nothing is hidden."""


@dataclass(frozen=True)
class Scenario:
    """One campaign: a scene's kind and seed, hidden causes, their size in noise."""

    kind: str
    seed: int
    causes: tuple[str, ...]
    multiple: int

    @property
    def label(self) -> str:
        """What is hidden, for people."""
        return " + ".join(self.causes) or "nothing"


def scenarios() -> Iterator[Scenario]:
    """All scenarios, over all structures; then those that need scenes of their own."""
    kinds = list(STRUCTURES)
    names = _names()
    i = 0
    for multiple in MULTIPLES:
        for name in names:
            yield Scenario(kinds[i % len(kinds)], 100 + i, (name,), multiple)
            i += 1
    for multiple in (6, 12):
        for pair in PAIRS:
            yield Scenario(kinds[i % len(kinds)], 100 + i, pair, multiple)
            i += 1
    for _ in range(EMPTY):
        yield Scenario(kinds[i % len(kinds)], 100 + i, (), 0)
        i += 1
    for k, multiple in enumerate(MULTIPLES):
        for name, scenes in ELSEWHERE.items():
            # by the name, so that a further cause moves no other's seed
            code = zlib.crc32(name.encode())
            seed = 1000 + 20 * (code % 10_000) + multiple
            yield Scenario(scenes[(code + k) % len(scenes)], seed, (name,), multiple)
    for kind in EMPTY_ELSEWHERE:
        yield Scenario(kind, 1000 + 20 * (zlib.crc32(kind.encode()) % 10_000), (), 0)


def _names() -> list[str]:
    machine = draw(0, "bridge")
    rng = np.random.default_rng(0)
    names = list(catalogue(machine.axes, machine.travels, rng))
    names += list(further(machine.axes, machine.travels, rng))
    names += list(left_out(machine.axes, rng))
    return [*names, *uncatalogued(machine.axes, machine.travels, rng)]


def hide(scenario: Scenario, stage: Scene) -> list[tuple[Cause, float]]:
    """The causes, so large that what they add to a row is at most the multiple of the noise.

    Less the set-up's mean, which its unknown zero swallows.
    """
    causes = stage.causes()
    hidden = []
    for name in scenario.causes:
        cause = causes[name]
        if not cause.size:
            hidden.append((cause, 0.0))
            continue
        seen = stage.simulate([(cause, cause.size)]).hidden
        size = cause.size * scenario.multiple * NOISE / float(np.abs(seen).max())
        hidden.append((cause, size))
    return hidden
