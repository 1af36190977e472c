"""What a model corrects over the volume, beside what it is unsure by there."""

from __future__ import annotations

import numpy as np

from abbe.compcore.planning.knowledge import VolumeError, prior, scaled_values
from abbe.compcore.planning.targets import SurveyTask


def corrected_and_unsure(task: SurveyTask) -> tuple[float, float]:
    """What a model corrects over the volume, and its standard uncertainty there, rms, mm.

    Both of the length of the error vector, but for moves of the workpiece as a whole.
    """
    volume = VolumeError.of(task)
    values = scaled_values(task.model)
    square = float(values @ volume.weight @ values)
    corrected = float(np.sqrt(max(square, 0.0)))
    return corrected, volume.mean(prior(task.model, 0.0))
