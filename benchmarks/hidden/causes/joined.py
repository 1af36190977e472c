"""A scale of two tapes whose joint is wider than the pitch: beyond it all stands a step further.

From what a reading head does that looks at both tapes for a few millimetres, for the exact chain,
with no view of the effects' code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.hidden.causes.cause import Cause, six

NAMES = ("joint of a scale",)
HEAD = 8.0
"""mm that the reading head looks at: it takes the mean of the lines that it sees."""


def joined(
    axes: Sequence[str], travels: Mapping[str, tuple[float, float]], rng: np.random.Generator
) -> dict[str, Cause]:
    """One cause for each of `NAMES`, on a machine with three linear axes."""
    axis = list(axes)[int(rng.integers(3))]
    low, high = travels[axis]
    place = low + (high - low) * float(rng.uniform(0.3, 0.7))
    return {
        NAMES[0]: Cause(
            NAMES[0],
            axis,
            lambda s: six(
                s, "XYZ".index(axis), np.clip((np.asarray(s[axis]) - place) / HEAD + 0.5, 0.0, 1.0)
            ),
            (("joint", {"axis": axis, "error": f"E_{axis}{axis}"}),),
        )
    }
