"""The live step of a machine without one or two of X, Y, Z: a lathe, a slit, an arm with a quill.

What its axes cannot move is left: the moves are the least squares of
`abbe.compcore.machine.kinematics.Chain.as_moves`, and those of the axes that are missing are 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.folding.tables import FoldedTables
from abbe.compcore.compensator.rotation import IDENTITY, Triple, apply
from abbe.compcore.compensator.step_general import (
    Step,
    chain_error,
    motions_at,
    stages_of,
    walk,
)
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Composition


def few_axes_step(
    machine: Machine, composition: Composition, tables: FoldedTables, state: SlowState
) -> Step:
    """The step of a machine that has one or two of X, Y, Z, with the state's tool."""
    zero = {a: np.zeros(1) for a in machine.structure.axes}
    tool: Triple = tuple(Chain(machine, state.conditions(zero, {})).tool[0].tolist())
    motions, error = motions_at(tables), chain_error(tables, composition)
    stages = stages_of(machine, tables.error_motions)
    letters = [("XYZ".index(a), machine.axis(a).direction) for a in machine.structure.carrying]

    def step(positions: Sequence[float], directions: Sequence[float]) -> Triple:
        v = motions(positions, directions)
        visits, turn, sx, sy, sz, bed, carried = walk(stages, positions)
        gx, gy, gz = tool if turn is IDENTITY else apply(turn, *tool)
        ex, ey, ez, _ = error(visits, v, sx + gx, sy + gy, sz + gz, bed)
        ways = [(k, apply(carried[k], *direction)) for k, direction in letters]
        found = [0.0, 0.0, 0.0]
        if len(ways) == 1:
            ((k, (a, b, c)),) = ways
            found[k] = (a * ex + b * ey + c * ez) / (a * a + b * b + c * c)
        else:
            (j, (a, b, c)), (k, (d, e, f)) = ways
            one, two, both = a * a + b * b + c * c, d * d + e * e + f * f, a * d + b * e + c * f
            first, second = a * ex + b * ey + c * ez, d * ex + e * ey + f * ez
            size = one * two - both * both
            found[j] = (two * first - both * second) / size
            found[k] = (one * second - both * first) / size
        return found[0], found[1], found[2]

    return step
