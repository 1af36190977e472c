"""Set-ups that visit the same places: a line that was measured on several days is one line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary

_NEAR = 1.0
"""mm, or degrees, within which two targets are one."""
_SHARED = 0.5
"""Part of a set-up's places that another one visits, too, from which both are the same line."""


def same_lines(conditions: Conditions) -> list[NDArray[np.int64]]:
    """Rows of set-ups that visit the same places together, others apart; empty without set-ups."""
    setup = conditions.setup
    if setup is None or not conditions.positions:
        return []
    shown = {a: np.degrees(q) if is_rotary(a) else q for a, q in conditions.positions.items()}
    at = np.column_stack(list(shown.values()))
    _, target = np.unique(np.round(at / _NEAR), axis=0, return_inverse=True)
    target = target.reshape(-1)
    groups: list[tuple[set[int], list[NDArray[np.int64]]]] = []
    _, of = np.unique(setup, return_inverse=True)
    of = of.reshape(-1)
    for one in range(int(of.max(initial=-1)) + 1):
        rows = np.flatnonzero(of == one)
        places = set(target[rows].tolist())
        found = [g for g in groups if len(g[0] & places) > _SHARED * min(len(g[0]), len(places))]
        merged = (places, [rows])
        for group in found:
            merged = (merged[0] | group[0], merged[1] + group[1])
            groups.remove(group)
        groups.append(merged)
    return [np.sort(np.concatenate(rows)) for _, rows in groups]
