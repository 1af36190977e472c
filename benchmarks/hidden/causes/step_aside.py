"""A carriage that steps aside when it reverses: play in a guide, a drive that pulls from one side.

From the guide's two flanks, for the exact chain, with no view of the effects' code.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.hidden.causes.cause import Cause, six

NAMES = ("step aside at reversal",)


def aside(axes: Sequence[str], rng: np.random.Generator) -> dict[str, Cause]:
    """One cause for each of `NAMES`, on a machine with three linear axes."""
    axis = list(axes)[int(rng.integers(3))]
    across = [d for d in "XYZ" if d != axis][int(rng.integers(2))]
    return {
        NAMES[0]: Cause(
            NAMES[0],
            axis,
            lambda s: six(s, "XYZ".index(across), 0.5 * np.asarray(s[f"{axis}_dir"])),
            (("lateral_reversal", {"axis": axis, "direction": across}),),
        )
    }
