"""Choice of tables where a controller has room for fewer than would be of use."""

from __future__ import annotations

from collections.abc import Sequence

from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.tables.capability import Capability
from abbe.compcore.tables.projection.curves.curve import Curve

_LEVER = 3.0
"""A lever's offset from the middle has a third of the mean square of its greatest."""


def chosen(
    curves: Sequence[Curve], capability: Capability, besides: Sequence[Curve] = ()
) -> tuple[list[Curve], list[Curve]]:
    """The tables that together take most off the error, as many as the controller has room for.

    The parts are orthogonal over the volume, so that each takes off its own mean square whatever
    the others do; the best set is found exactly, by dynamic programming (a knapsack).

    Parameters
    ----------
    curves
        What would be of use.
    capability
        How many tables there are.
    besides
        Tables that are taken in any case.

    Returns
    -------
    Those that are to be made and those that are not, both in their order.
    """
    most, per_output = capability.most_tables, capability.per_output
    room = 0 if most is None else most - sum(_takes(c) for c in besides)
    # (tables used, outputs of those that are kept) → (mean square taken off, which)
    best: dict[tuple[int, tuple[ErrorMotion, ...]], tuple[float, tuple[int, ...]]] = {
        (0, ()): (0.0, ())
    }
    for i, curve in enumerate(curves):
        takes = 0 if most is None else _takes(curve)
        worth = _worth(curve)
        for (used, outputs), (total, kept) in list(best.items()):
            if per_output is not None:
                if outputs.count(curve.output) >= per_output:
                    continue
                outputs = tuple(sorted((*outputs, curve.output), key=str))
            if used + takes > room:
                continue
            state, offered = (used + takes, outputs), (total + worth, (*kept, i))
            if state not in best or best[state][0] <= offered[0]:
                best[state] = offered
    _, taken = max(best.values(), key=lambda found: (found[0], len(found[1])))
    return (
        [c for i, c in enumerate(curves) if i in taken],
        [c for i, c in enumerate(curves) if i not in taken],
    )


def _takes(curve: Curve) -> int:
    """How many of the controller's own tables one takes."""
    return curve.holds.takes[1 if curve.holds.directional and curve.directional else 0]


def _worth(curve: Curve) -> float:
    """Mean square that one takes off the error, mm²."""
    square = float((curve.values * curve.reach).var())
    return square if curve.lever is None else square / _LEVER
