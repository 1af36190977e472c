"""A few SVG shapes with short numbers, so that pictures stay small and comparable as text."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np
from numpy.typing import ArrayLike


def _number(value: float) -> str:
    text = f"{value:.1f}"
    return text[:-2] if text.endswith(".0") else text


class Drawing:
    """An SVG picture under construction; coordinates in pixels, y downwards."""

    def __init__(self, width: int, height: int, style: str) -> None:
        self._size = width, height
        self._style = style
        self._parts: list[str] = []

    def path(self, points: ArrayLike, css: str) -> None:
        """A polyline through points of shape (n, 2)."""
        rows = np.asarray(points, dtype=np.float64)
        text = "L".join(f"{_number(x)} {_number(y)}" for x, y in rows)
        self._parts.append(f'<path class="{css}" d="M{text}"/>')

    def paths(self, many: Iterable[ArrayLike], css: str) -> None:
        """Several polylines of one look, as one element."""
        parts = []
        for points in many:
            rows = np.asarray(points, dtype=np.float64)
            parts.append("M" + "L".join(f"{_number(x)} {_number(y)}" for x, y in rows))
        self._parts.append(f'<path class="{css}" d="{"".join(parts)}"/>')

    def dot(self, x: float, y: float, radius: float, css: str) -> None:
        """A filled circle."""
        self._parts.append(
            f'<circle class="{css}" cx="{_number(x)}" cy="{_number(y)}" r="{_number(radius)}"/>'
        )

    def text(self, x: float, y: float, words: str, css: str = "", anchor: str = "start") -> None:
        """One line of text."""
        look = f' class="{css}"' if css else ""
        place = "" if anchor == "start" else f' text-anchor="{anchor}"'
        self._parts.append(
            f'<text{look} x="{_number(x)}" y="{_number(y)}"{place}>{escape(words)}</text>'
        )

    def render(self, title: str) -> str:
        """The SVG text."""
        width, height = self._size
        body = "\n".join(self._parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" role="img">\n'
            f"<title>{escape(title)}</title>\n<style>{self._style}</style>\n"
            f'<rect class="ground" width="{width}" height="{height}"/>\n{body}\n</svg>\n'
        )
