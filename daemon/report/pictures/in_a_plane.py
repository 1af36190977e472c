"""A picture of what lies in a plane, or along a line: seen square to it, as a drawing has it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.daemon.report.pictures.view import GRID, View, round_numbers, segments, text

F64 = NDArray[np.float64]

_LYING = {0: (1, 2), 1: (2, 0), 2: (0, 1)}
"""The flat direction → the axes to the right and up, seen square to it."""


def plane(flat: NDArray[np.bool_]) -> tuple[int, int] | None:
    """The axes to the right and up of what lies in a plane or along a line; None: it does not.

    Of a lathe Z lies and X stands, as the machine does.
    """
    if not flat.any() or flat.all():
        return None
    across, up = _LYING[int(np.flatnonzero(flat)[0])]
    return (up, across) if flat[across] else (across, up)


def sheet(
    view: View, low: F64, high: F64, titles: Sequence[str], seen: tuple[int, int],
    flat: NDArray[np.bool_],
) -> Iterator[str]:  # fmt: skip
    """Lines and numbers of a picture in a plane: below it and at its left."""
    ends = np.stack([low, high])
    lines, words = [], []
    for k, over in (seen, seen[::-1]):
        if flat[k]:
            continue
        ticks = round_numbers(low[k], high[k])
        for value in [low[k], *ticks, high[k]]:
            pair = np.tile(low, (2, 1))
            pair[:, k], pair[:, over] = value, ends[:, over]
            lines.append(pair)
        places = np.tile(low, (len(ticks) + 1, 1))
        places[:, k] = [*ticks, 0.5 * (low[k] + high[k])]
        where = view(places)
        if k == seen[0]:
            words += [(x, y + 20.0, t, "middle", False) for (x, y), t in _numbered(where, ticks)]
            words.append((where[-1, 0], where[-1, 1] + 38.0, titles[k], "middle", False))
        else:
            words += [(x - 10.0, y + 4.0, t, "end", False) for (x, y), t in _numbered(where, ticks)]
            words.append((where[-1, 0] - 58.0, where[-1, 1], titles[k], "middle", True))
    yield f'<path stroke="{GRID}" stroke-width="0.8" d="{segments(view, lines)}"/>'
    for x, y, said, anchor, turned in words:
        yield text(x, y, said, anchor, turned=turned)


def _numbered(where: F64, ticks: Sequence[float]) -> Iterator[tuple[F64, str]]:
    for place, value in zip(where, ticks, strict=False):
        yield place, f"{value:g}".replace("-", "−")
