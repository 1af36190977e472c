"""Compensate: positions and signals → correction, and which directions a lost signal affects."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.compensator.pose_step import PoseError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import FUNCTIONAL_POINT
from abbe.compcore.machine.lag import LagState
from abbe.compcore.machine.machine import own_component
from abbe.compcore.model.lags import lags_of
from abbe.compcore.model.model import Model
from abbe.daemon.guard import DIRECTIONS, Correction, Vec3
from abbe.daemon.pipeline.reading.convert import SignalReading

logger = logging.getLogger("abbe.pipeline")

_TURNS = {"A": ("Y", "Z"), "B": ("X", "Z"), "C": ("X", "Y")}
"""Directions in which a rotation moves the functional point through its lever."""


def affected_directions(model: Model) -> dict[str, int]:
    """Which directions of the correction each signal has a part in.

    Told from the error motions that the signal's effects move: a translation counts for its own
    direction, a rotation for the two across it. Where a rotary axis turns levers and directions,
    all three count.

    Returns
    -------
    Signal → mask, bit 0 X, 1 Y, 2 Z.
    """
    machine = model.machine
    masks = dict.fromkeys(model.signals_needed(), 0)
    here = Conditions.at(
        {name: axis.middle for name, axis in machine.axes.items()},
        signals=dict.fromkeys(masks, machine.reference_temperature),
    )
    for term in model.terms:
        if not term.fitted or term.effect.scope == "instrument":
            continue
        mask = 0
        for motion in term.effect.motions(machine, here, term.nonlinear(machine)):
            component = motion.error_motion.component
            turned = machine.structure.rotary and motion.error_motion.place != FUNCTIONAL_POINT
            for i, direction in enumerate(DIRECTIONS):
                if turned or direction in _TURNS.get(component, (component,)):
                    mask |= 1 << i
        for name in term.effect.signals_needed():
            masks[name] |= mask
    return masks


class LiveCompensator:
    """A compensator that never fails: what it cannot compute is None, with the reason.

    Parameters
    ----------
    model
        The model; its fitted effects count, those that are switched on for the correction.
    turning
        Rotary axes that are corrected too.

    Attributes
    ----------
    axes
        The order of positions in `step`.
    directions
        The order of a correction: X, Y, Z and the rotary axes that are corrected.
    pose
        What the last step said of the pose; None where no rotary axis is corrected.
    shown
        What effects that are only shown gave at the last step, in X, Y, Z, mm; None: nothing.
    tool
        The tool's offset, mm.
    fault
        Why there is no correction at present; empty when there is one.
    faulty
        Mask of directions that rest on a signal which is missing.
    uses_directions
        Whether any effect asks in which direction an axis moved.
    """

    def __init__(self, model: Model, turning: Sequence[str] = ()) -> None:
        applied, only_shown = model.switched("on"), model.switched("shown")
        self._compensator = Compensator(applied, turning=turning)
        if direct := self._compensator.direct_effects:
            logger.info("computed at every point, as no table holds them: %s", "; ".join(direct))
        self._shown = None if not only_shown.terms else Compensator(only_shown)
        self._resting = {
            key: LagState(key[1])
            for key in lags_of(model)
            if key not in self._compensator.lag_states
        }
        """Lags of effects that are not applied: a machine's warmth goes on without them."""
        self._shown_ready = False
        self.shown: Vec3 | None = None
        self._poses = bool(turning)
        self.axes = self._compensator.axes
        self.directions = (*DIRECTIONS, *turning)
        self.pose: PoseError | None = None
        self.uses_directions = any(
            term.fitted and term.effect.directions_used() for term in model.terms
        )
        self._affected = {
            **dict.fromkeys(model.signals_needed(), 0),
            **affected_directions(applied),
        }
        machine = model.machine
        self._unseen = {
            name: machine.reference_temperature if machine.signals[name].temperature else 0.0
            for name in self._affected
        }
        """Signals without a first value, and what stands in for them: their directions are off."""
        self._ready = False
        self.tool: Vec3 = (0.0, 0.0, 0.0)
        self.fault = ""
        self.faulty = 0

    def continue_from(
        self, before: LiveCompensator, time: float, readings: Mapping[str, SignalReading]
    ) -> None:
        """Go on in the place of another one, at `time` (monotonic, s), with its last readings."""
        self._unseen = {n: v for n, v in self._unseen.items() if n in before._unseen}
        known = {**before._resting, **before._compensator.lag_states}
        self._compensator.continue_lags(known)
        if self._shown is not None:
            self._shown.continue_lags(known)
        self._resting.update({k: replace(known[k]) for k in self._resting if k in known})
        self.update(time, readings)

    def update(self, time: float, readings: Mapping[str, SignalReading]) -> None:
        """Take signals in: their last good values; what has none yet counts as missing.

        `time` is monotonic, in s, the time base of lags.
        """
        mask = 0
        values = {}
        late = []
        for name, directions in self._affected.items():
            reading = readings[name]
            if reading.fault:
                mask |= directions
            if math.isfinite(reading.value):
                values[name] = reading.value
                if self._unseen.pop(name, None) is not None:
                    late.append(name)
            else:
                values[name] = self._unseen[name]
        self.faulty = mask
        try:
            for name in late if self._ready else ():
                # lags begin in equilibrium with the first value, which the stand-in is not
                self._compensator.restart_lags(name)
            self._compensator.update(time, values)
            for key, lag in self._resting.items():
                if key[0] in late:
                    self._resting[key] = lag = LagState(key[1])
                lag.step(time, values[key[0]])
        except Exception as error:  # noqa: BLE001  (whatever it is, the guard has to act on it)
            self._failed(error)
            self._ready = False
        else:
            self._ready = True
        self._update_shown(time, values)

    def _update_shown(self, time: float, values: Mapping[str, float]) -> None:
        """What is only shown takes nothing down when it fails."""
        if self._shown is None:
            return
        try:
            self._shown.update(time, values)
            self._shown_ready = True
        except Exception as error:  # noqa: BLE001
            if self._shown_ready:
                logger.warning("what is only shown cannot be computed: %s", error)
            self._shown_ready = False

    def _shown_at(self, positions: Sequence[float], directions: Sequence[float]) -> Vec3 | None:
        if self._shown is None or not self._shown_ready:
            return None
        try:
            return self._shown.step(positions, directions)
        except Exception:  # noqa: BLE001  (as above)
            return None

    def set_tool(self, offset: Vec3) -> None:
        """Change the tool's offset, mm."""
        self.tool = offset
        self._compensator.set_tool(*offset)
        if self._shown is not None:
            self._shown.set_tool(*offset)

    def step(self, positions: Sequence[float], directions: Sequence[float]) -> Correction | None:
        """Correction in X, Y, Z (mm) and of the rotary axes that are corrected (rad).

        At positions in mm (rotary: rad); None when there is none.

        `directions` may be empty where no effect uses them.
        """
        if not self._ready:
            return None
        correction: Correction
        try:
            if self._poses:
                self.pose = self._compensator.pose(positions, directions)
                correction = self.pose.moves
            else:
                correction = self._compensator.step(positions, directions)
        except Exception as error:  # noqa: BLE001  (as in `update`)
            self._failed(error)
            return None
        if not math.isfinite(sum(correction)):
            self._failed(ArithmeticError(f"the correction is {correction}"))
            return None
        self.fault = ""
        if self._shown is not None:
            self.shown = self._shown_at(positions, directions)
        return correction

    def _failed(self, error: Exception) -> None:
        reason = f"{type(error).__name__}: {error}"
        if reason != self.fault:
            self.fault = reason
            logger.error("the compensator failed: %s", reason, exc_info=error)


def direction_index(axis: str, directions: Sequence[str] = DIRECTIONS) -> int:
    """Which component of the correction an axis takes: 0 X, 1 Y, 2 Z, then the rotary ones.

    >>> direction_index("X"), direction_index("W"), direction_index("C", ("X", "Y", "Z", "B", "C"))
    (0, 2, 4)
    """
    return directions.index(axis if axis in directions else own_component(axis))
