"""A reading that was typed or measured → the rows that are recorded of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.fitting.design.superposition import uncompensated
from abbe.compcore.model.model import Model
from abbe.compcore.monitoring.readings import check_readings
from abbe.daemon.arguments.measurements.check_reading import TypedReading

_ROUNDS = 3
"""Each shrinks what is left by the error's slope, some 1e-4."""


def check_rows(
    typed: TypedReading,
    model: Model,
    now: float,
    before: Campaign | None,
    known: Mapping[str, float],
    active: Model | None = None,
) -> Campaign:
    """The rows of a reading, as the machine without compensation would have shown it.

    Parameters
    ----------
    typed
        What was read.
    model
        That the checks are held against.
    now
        s since 1970.
    before
        The checks so far.
    known
        Signals that need not be typed.
    active
        The model that corrected while it was read, with its switches; None: nothing did.

    Raises
    ------
    InputError
        When something is missing, or cannot be judged.
    """
    corrected = None if active is None else active.switched()
    if corrected is not None and typed.found is not None:
        typed = _indicated(typed, model, now, known, corrected)
        corrected = None
    new = typed.campaign(model, now, before, known)
    if corrected is not None:
        require_signals(new, corrected)
        new = uncompensated(new, corrected)
    # what cannot be judged is not recorded either
    check_readings(model, new)
    return new


def _indicated(
    typed: TypedReading, model: Model, now: float, known: Mapping[str, float], corrected: Model
) -> TypedReading:
    """The same sphere, found where the encoders were: `i` with `i + error(i) = found`."""
    said = typed.found or (0.0, 0.0, 0.0)
    found = typed
    for _ in range(_ROUNDS):
        rows = found.campaign(model, now, None, known)
        require_signals(rows, corrected)
        error = np.diag(corrected.predict(rows.conditions).translation)
        x, y, z = (np.array(said) - error).tolist()
        found = replace(typed, found=(x, y, z))
    return found
