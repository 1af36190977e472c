"""The record of one cycle, for the live screen, JSON lines and statistics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from abbe.compcore.compensator.pose_step import PoseError
from abbe.daemon.guard import DIRECTIONS, Decision
from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.daemon.status_word import Status


class CycleRecord(NamedTuple):
    """One cycle. Lengths in mm, angles in rad, times in s.

    Attributes
    ----------
    number
        Counts cycles from 1.
    time
        When the positions had arrived, since the run's start.
    indicated
        By axis, in the order of `Pipeline.axes`; NaN where not to be believed.
    corrected
        By axis, in the order of `Pipeline.corrected_axes`: indicated + correction; NaN where
        indicated is.
    decision
        What the guard handed out.
    status
        The status word that was written.
    signals
        Last readings.
    faults
        What is wrong at present: what → why.
    reference
        Independent positions by axis; NaN where there is none.
    duration
        From the beginning of the poll to the end of the write-back.
    written
        Whether the controller took all corrected positions.
    age
        Time from the earliest moment at which the positions can have been taken until they were
        about to be written.
    speeds
        By axis, as measured, mm/s (rotary: rad/s): age × speed is how far it may have moved since.
    directions
        Of the decision: X, Y, Z and the rotary axes that are corrected.
    pose
        What the rotary axes leave of the tool's direction; None where none is corrected.
    shown
        What effects that are only shown would give in X, Y, Z; None where there are none.
    writes
        Whether corrected positions are written at all; else they are computed only.
    """

    number: int
    time: float
    indicated: tuple[float, ...]
    corrected: tuple[float, ...]
    decision: Decision
    status: int
    signals: Mapping[str, SignalReading]
    faults: Mapping[str, str]
    reference: tuple[float, ...]
    duration: float
    written: bool
    age: float = 0.0
    speeds: tuple[float, ...] = ()
    directions: tuple[str, ...] = DIRECTIONS
    pose: PoseError | None = None
    shown: tuple[float, float, float] | None = None
    writes: bool = True

    @property
    def in_full(self) -> bool:
        """Whether every direction is corrected in full, and the controller took it."""
        taken = self.status & Status.COMPENSATING
        return self.writes and self.decision.compensating and bool(taken)


Listener = Callable[[CycleRecord], None]
"""Is called at the end of every cycle, in the event loop: must be quick and must not raise."""
