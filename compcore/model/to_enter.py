"""What to enter in a controller for its rotary axes: lines and the spindle, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.model.as_built import average_lines
from abbe.compcore.model.held_spindle import held_spindle, where_they_are
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import said

F64 = NDArray[np.float64]


def average_line_words(model: Model, tool: F64 | None = None) -> Iterator[str]:
    """Sentences about the rotary axes' lines, and where a head holds its spindle (and a tool)."""
    said_before = False
    for line in average_lines(where_they_are(model)):
        yield from line.words()
        said_before = True
    if held := held_spindle(model, tool):
        yield from held.words()
        said_before = True
    if said_before:
        yield said(
            "entered in the controller, a place is no error any more: take the effect out of the "
            "model, or it is corrected twice"
        )
