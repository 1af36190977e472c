"""The simulated trunnion machine: which errors it has, and what its display and an R-test show.

``w C' A' b X Y Z t``: the table C' stands on the trunnion A'. The exact chain, nothing of
`compcore`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from abbe.drivers.simulated.bridge.truth import ExactAxis, ExactMachine, State

Array = NDArray[np.float64]

STRUCTURE: Final = "w C' A' b X Y Z t"
AXES: Final = ("X", "Y", "Z", "A", "C")
ROTARY: Final = ("A", "C")
TOOL: Final = (0.0, 0.0, -120.0)
"""Offset of the R-test's nest, mm."""
TABLE: Final = (250.0, 200.0, -450.0)
"""A point on the lines of A and C, mm, as the controller has it."""


def make_trunnion() -> ExactMachine:
    """The machine: its rotary axes lie wrong by some 50 µm and 60 µrad, all else is little."""
    return ExactMachine(
        STRUCTURE,
        {
            "C": ExactAxis(
                actual=lambda state: _turned(state["C"], 20e-6),
                mount=_at_table((0.030, -0.020, 0.0, 40e-6, -25e-6, 0.0)),
                location=TABLE,
            ),
            "A": ExactAxis(
                actual=lambda state: _turned(state["A"], 15e-6),
                mount=_at_table((0.0, 0.045, -0.025, 0.0, 30e-6, -60e-6)),
                location=TABLE,
            ),
            "X": ExactAxis(actual=lambda state: np.asarray(state["X"]) * (1.0 + 6e-6)),
            "Y": ExactAxis(mount=(0.0, 0.0, 0.0, 0.0, 0.0, 8e-6)),
        },
    )


def _turned(q: ArrayLike, wrong: float) -> Array:
    shown = np.asarray(q, dtype=float)
    return np.asarray(shown + wrong * np.sin(shown))


def _at_table(six: Sequence[float]) -> tuple[float, ...]:
    """Six numbers of a body that is moved and turned about the table's middle, about the origin."""
    turn = np.asarray(six[3:])
    moved = np.asarray(six[:3]) - np.cross(turn, np.asarray(TABLE))
    return (*moved.tolist(), *turn.tolist())


@dataclass
class TrunnionShop:
    """The machine as it stands, and a sphere on its table that an R-test in the spindle reads.

    Attributes
    ----------
    machine
        Its truth.
    noise
        Standard deviation of a reading of the R-test, mm.
    at
        Where each axis shows to stand, mm and degrees.
    sphere
        Where the sphere stands on the table, all rotary axes at 0, mm.
    """

    machine: ExactMachine = field(default_factory=make_trunnion)
    noise: float = 0.2e-3
    at: dict[str, float] = field(default_factory=lambda: dict.fromkeys(AXES, 0.0))
    sphere: tuple[float, float, float] = TABLE

    def __post_init__(self) -> None:
        self._random = random.Random("R-test")

    def go(self, to: Mapping[str, float]) -> None:
        """Have axes stand elsewhere, mm and degrees."""
        self.at |= {name: float(to[name]) for name in to}

    def state(self) -> State:
        """The exact machine's state."""
        return {n: math.radians(q) if n in ROTARY else q for n, q in self.at.items()}

    def error(self) -> Array:
        """Actual − indicated of the nest, in machine axes, mm."""
        state = self.state()
        turned = self.machine.nominal_pose(state)[:3, :3]
        return np.asarray(turned.T @ self.machine.error(state, TOOL))

    def reading(self) -> list[float]:
        """What the three sensors show: the nest's middle less the sphere, machine axes, mm."""
        state = self.state()
        turned = self.machine.nominal_pose(state)[:3, :3]
        apart = turned.T @ (self.machine.point(state, TOOL) - np.asarray(self.sphere))
        return [float(x) + self._random.gauss(0.0, self.noise) for x in apart]


@dataclass
class Display:
    """The machine's display: ``R`` is answered by all axes, ``X+00012.3456 … A+00090.00000``."""

    shop: TrunnionShop

    def answer(self, query: str) -> str:
        """As `AsciiDevice.answer`."""
        return self.spontaneous() if query == "R" else "?"

    def spontaneous(self) -> str:
        """All axes."""
        return " ".join(f"{name}{self.shop.at[name]:+012.5f}" for name in AXES)


@dataclass
class RTest:
    """The nest's box: ``R`` is answered by its three sensors, ``+00.01234 -00.00231 +00.00012``."""

    shop: TrunnionShop

    def answer(self, query: str) -> str:
        """As `AsciiDevice.answer`."""
        return self.spontaneous() if query == "R" else "?"

    def spontaneous(self) -> str:
        """The three sensors."""
        return " ".join(f"{x:+09.5f}" for x in self.shop.reading())
