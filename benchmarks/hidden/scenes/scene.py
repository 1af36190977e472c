"""A scene: a simulated machine, what may be hidden in it, its campaigns and its user's model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from benchmarks.hidden.campaigns.campaign import STRUCTURES, Machine, draw, model_text, simulate
from benchmarks.hidden.campaigns.measuring import Hidden, Simulated
from benchmarks.hidden.campaigns.rotary_plan import LAYOUTS
from benchmarks.hidden.causes.beyond import beyond
from benchmarks.hidden.causes.catalogued import catalogue
from benchmarks.hidden.causes.cause import Cause
from benchmarks.hidden.causes.further import further, left_out
from benchmarks.hidden.causes.joined import joined
from benchmarks.hidden.causes.step_aside import aside
from benchmarks.hidden.causes.uncatalogued import uncatalogued
from benchmarks.hidden.scenes import bare, distances, instrument
from benchmarks.hidden.scenes.rotary import Rotary


class Scene(Protocol):
    """One machine on one day."""

    def causes(self) -> dict[str, Cause]:
        """What may be hidden in it, by name."""

    def simulate(self, causes: Hidden, *, held_out: bool = False) -> Simulated:
        """Measure it with causes hidden at their amplitudes; `held_out`: other places."""

    def model_text(self, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
        """The model that its user brings, less what it lacks (kind and where-keys)."""


@dataclass(frozen=True)
class Usual:
    """A machine with three linear axes and a user who models all its 21 errors and expansions."""

    machine: Machine
    seed: int

    @classmethod
    def drawn(cls, seed: int, kind: str) -> Usual:
        """A scene by its seed and the machine's structure, a key of `STRUCTURES`."""
        return cls(draw(seed, kind), seed)

    def causes(self) -> dict[str, Cause]:
        """All causes that a machine with three linear axes can have."""
        axes, travels = self.machine.axes, self.machine.travels
        rng = np.random.default_rng((self.seed, 7))
        found = catalogue(axes, travels, rng) | uncatalogued(axes, travels, rng)
        rng = np.random.default_rng((self.seed, 8))
        found |= further(axes, travels, rng) | left_out(axes, rng)
        found |= beyond(axes, travels, np.random.default_rng((self.seed, 9)))
        found |= aside(axes, np.random.default_rng((self.seed, 10)))
        return found | joined(axes, travels, np.random.default_rng((self.seed, 11)))

    def simulate(self, causes: Hidden, *, held_out: bool = False) -> Simulated:
        """Lines by laser, angles by level, through a day."""
        return simulate(self.machine, self.seed, causes, held_out=held_out)

    def model_text(self, omits: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> str:
        """Geometry and expansion, nothing fitted."""
        return model_text(self.machine, omits)


SCENES: dict[str, Callable[[int, str], Scene]] = {
    **dict.fromkeys(STRUCTURES, Usual.drawn),
    **dict.fromkeys(LAYOUTS, Rotary.drawn),
    **dict.fromkeys(bare.kinds(tuple(bare.MODELLED)), bare.Bare.drawn),
    **dict.fromkeys(instrument.kinds(instrument.WORDS), instrument.Measured.drawn),
    **dict.fromkeys(distances.kinds(), distances.Distances.drawn),
}
"""A scenario's kind → how its scene is drawn from a seed and that kind."""


def scene(seed: int, kind: str) -> Scene:
    """The scene of a scenario."""
    return SCENES[kind](seed, kind)
