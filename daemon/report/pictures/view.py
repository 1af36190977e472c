"""A projection of points in space into a drawing in SVG, its lines and its words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import floor, log10

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

WIDTH, HEIGHT = 720.0, 500.0
_LEFT, _RIGHT, _EDGE = 92.0, 130.0, 46.0
_INK, GRID = "#1b1f24", "#d0d7de"
_TICKS = 4


@dataclass(frozen=True)
class View:
    """The projection: `across` and `up` are unit vectors in the picture, `towards` to the eye."""

    across: F64
    up: F64
    towards: F64
    scale: float
    shift: F64

    @classmethod
    def of(cls, eye: Sequence[float], corners: F64) -> View:
        """Seen from an eye, with the corners of the box within the drawing."""
        towards = np.asarray(eye, dtype=np.float64)
        towards = towards / np.linalg.norm(towards)
        across = np.cross([0.0, 0.0, 1.0], towards)
        across /= np.linalg.norm(across)
        return cls._along(across, np.cross(towards, across), corners)

    @classmethod
    def square(cls, across: int, up: int, corners: F64) -> View:
        """Seen square to the plane of two axes, as a drawing shows it."""
        return cls._along(np.eye(3)[across], np.eye(3)[up], corners)

    @classmethod
    def _along(cls, across: F64, up: F64, corners: F64) -> View:
        towards = np.cross(across, up)
        flat = corners @ np.stack([across, up], axis=1)
        low, size = flat.min(axis=0), np.ptp(flat, axis=0)
        room = np.array([WIDTH - _LEFT - _RIGHT, HEIGHT - 2.0 * _EDGE])
        scale = float(np.min(room / np.maximum(size, 1e-12)))
        middle = (low + 0.5 * size) * scale
        at = np.array([_LEFT + 0.5 * room[0], _EDGE + 0.5 * room[1]])
        return cls(across, up, towards, scale, np.array([at[0] - middle[0], at[1] + middle[1]]))

    def __call__(self, points: F64) -> F64:
        """Points (n, 3) → places in the drawing (n, 2), y downwards."""
        flat = points @ np.stack([self.across, self.up], axis=1) * self.scale
        return np.stack([self.shift[0] + flat[:, 0], self.shift[1] - flat[:, 1]], axis=1)


def text(x: float, y: float, words: str, anchor: str, *, turned: bool = False) -> str:
    """Words at a place; `turned`: written upwards."""
    turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{_INK}" text-anchor="{anchor}"{turn}>'
        f"{escape(words)}</text>"
    )


def round_numbers(low: float, high: float) -> list[float]:
    """A few round numbers from `low` to `high`.

    >>> round_numbers(0.0, 700.0)
    [0.0, 200.0, 400.0, 600.0]
    """
    step = (high - low) / _TICKS
    power = 10.0 ** floor(log10(step))
    step = power * min((m for m in (1.0, 2.0, 5.0, 10.0)), key=lambda m: abs(m * power - step))
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
    return [round(i * step, 9) + 0.0 for i in range(first, last + 1)]


def segments(view: View, lines: Sequence[F64]) -> str:
    """Straight lines, (2, 3) each, as a path."""
    if not lines:
        return ""
    flat = view(np.concatenate(lines)).reshape(-1, 2, 2)
    return "".join(f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in flat)
