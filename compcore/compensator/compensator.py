"""The compensator: a model's error at the machine's pace, live or in batches.

It *folds* the model. Whatever changes slowly (temperatures, load, time) is evaluated through the
effects themselves, at a few hertz, into tables of error motions over each axis's position,
piecewise linear, with nodes chosen so that folding costs less than a tolerance anywhere in the
volume. What is left per point is one look-up an axis and the lever rule, in plain Python floats.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.batch import ChainBatch, LinearBatch
from abbe.compcore.compensator.folding.fold import Fold
from abbe.compcore.compensator.folding.metric import influences
from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.pose_step import PoseError, PoseStep, pose_step
from abbe.compcore.compensator.step_cartesian import Step, cartesian_step, nine
from abbe.compcore.compensator.step_few_axes import few_axes_step
from abbe.compcore.compensator.step_general import general_step
from abbe.compcore.errors import InputError, require_type
from abbe.compcore.machine.lag import LagState
from abbe.compcore.model.inverse import Inverse, invert
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]
Triple = tuple[float, float, float]

_FAR = 1000.0
"""Positions between which levers' change is measured, mm."""
_FEW = 48
"""Up to so many points are faster one by one."""
_NO_LEVER = 1e-12
"""Changes of a lever per mm below this are rounding."""
_REACH = 0.25
"""Tools up to this part of the longest travel are always reckoned with."""


class Compensator:
    """A model's error of the functional point, with live signals and lag states.

    Effects of the instrument are not the machine's and take no part. A model that reads signals or
    the clock answers only after the first `update`.

    Parameters
    ----------
    model
        The model; only its fitted effects count.
    tolerance_mm
        What folding may cost anywhere in the volume, mm.
    tool
        Tool or probe offset, mm, machine axes.
    turning
        Rotary axes that are corrected too, for `pose`.

    Attributes
    ----------
    model
        As given.
    axes
        The order of the positions in `step` and `errors`: the structure's, workpiece to tool.
    signals
        Names that `update` must be given.
    turning
        As given.

    Raises
    ------
    InputError
        When the machine has no axis X, Y or Z that could carry a correction, when `turning` names
        one that is no rotary axis of it, or where not all of X, Y, Z are there to take back what
        that moves.
    """

    def __init__(
        self,
        model: Model,
        *,
        tolerance_mm: float = 1e-5,
        tool: Triple = (0.0, 0.0, 0.0),
        turning: Sequence[str] = (),
    ) -> None:
        for axis in turning:
            if axis not in model.machine.structure.rotary:
                raise InputError(
                    "no rotary axis of the machine",
                    field="turning",
                    found=axis,
                    expected="one of " + (", ".join(model.machine.structure.rotary) or "none"),
                )
        self.turning = tuple(turning)
        require_type(model, Model, "model")
        if not tolerance_mm > 0.0:
            raise InputError("must be above zero", field="tolerance_mm", found=tolerance_mm)
        self.model = model
        self.axes = model.machine.structure.axes
        self._state = SlowState(tool=tool)
        self._carrying = model.machine.structure.carrying
        model.machine.structure.require_carrying()
        if turning and len(self._carrying) < len("XYZ"):
            raise InputError(
                f"a correction of {turning[0]} moves the tool's tip, and the machine lacks an axis "
                "X, Y or Z that takes that back",
                field="turning",
                found=str(model.machine.structure),
            )
        self._fold = Fold(model, tolerance_mm, self._reach(tool), self._state)
        self.signals = self._fold.signals
        self._lags = {key: LagState(key[1]) for key in self._fold.lags}
        self._waiting = bool(self.signals or self._fold.reads_time)
        self._step: Step = self._not_yet
        self._pose: PoseStep = self._no_pose_yet
        self._turn_tool()
        if not self._waiting:
            self._renew()

    @property
    def direct_effects(self) -> tuple[str, ...]:
        """Specs of effects that fit no table and are evaluated at every point, which is slow."""
        return tuple(source.effect.spec for source in self._fold.plan.direct)

    @property
    def nodes(self) -> dict[str, F64]:
        """Where the nodes of each axis's table stand, mm or rad; axes without a table left out."""
        return self._fold.nodes

    def set_tool(self, x: float, y: float, z: float, *, spindle_angle: float | None = None) -> None:
        """Change the tool or probe offset.

        Parameters
        ----------
        x, y, z
            Offset in machine axes, mm.
        spindle_angle
            Angle of the spindle in brackets, rad, with which the offset turns; None: it does not.
        """
        tool = (x, y, z)
        self._state = replace(self._state, tool=tool, spindle_angle=spindle_angle)
        self._turn_tool()
        if math.hypot(*tool) > self._fold.reach:
            reach = self._reach(tool)
            self._fold.lay_out(self._state, seen=not self._waiting, reach=reach)
        if not self._waiting:
            self._renew()

    def update(self, time_s: float, signals: Mapping[str, float]) -> bool:
        """Take in the present time and signals; False when nothing changed.

        Parameters
        ----------
        time_s
            s on any clock that keeps running; lags and drifts count from it.
        signals
            Name → value in the signal's own unit; more than `signals` does no harm.

        Raises
        ------
        InputError
            When a signal is missing or not a finite number; nothing has changed then.
        """
        values = {}
        for name in self.signals:
            value = signals.get(name)
            if value is None:
                raise InputError(
                    "a signal is missing", field=name, expected="all of " + ", ".join(self.signals)
                )
            if not math.isfinite(value):
                raise InputError("not a finite number", field=name, found=value)
            values[name] = float(value)
        state = replace(
            self._state,
            time=time_s if self._fold.reads_time else 0.0,
            signals=values,
            lags={key: lag.step(time_s, values[key[0]]) for key, lag in self._lags.items()},
        )
        if state == self._state and not self._waiting:
            return False
        self._state = state
        self._waiting = False
        self._renew()
        return True

    def restart_lags(self, signal: str) -> None:
        """Let a signal's lags begin anew, in equilibrium with its next value.

        For a sensor that has only now given its first value, or has been exchanged.
        """
        for key in self._lags:
            if key[0] == signal:
                self._lags[key] = LagState(key[1])

    @property
    def lag_states(self) -> Mapping[tuple[str, float], LagState]:
        """(signal, time constant in s) → its lag as of the last update."""
        return self._lags

    def continue_lags(self, before: Mapping[tuple[str, float], LagState]) -> None:
        """Take lags over from the `lag_states` of a compensator that ran before.

        A machine's warmth does not begin anew with a new model: each lag goes on from the state of
        the same signal's lag with the nearest time constant; a signal that had none begins in
        equilibrium with its next value.
        """
        for key in self._lags:
            signal, tau = key
            known = [lag for (name, _), lag in before.items() if name == signal]
            if known:
                nearest = min(known, key=lambda lag: abs(math.log(lag.tau / tau)))
                self._lags[key] = replace(nearest, tau=tau)

    def step(
        self, positions: Sequence[float], directions: Sequence[float] = ()
    ) -> tuple[float, float, float]:
        """Error at one point as moves of X, Y, Z, mm; corrected reading = reading + error.

        The move of an axis that the machine does not have is 0.

        Parameters
        ----------
        positions
            Indicated positions in the order of `axes`, mm (rotary: rad).
        directions
            Approach directions in the same order; the sign counts, 0: not known; none: all 0.
        """
        return self._step(positions, directions)

    def pose(self, positions: Sequence[float], directions: Sequence[float] = ()) -> PoseError:
        """Error of the pose at one point, as moves of X, Y, Z and of the axes in `turning`.

        Corrected positions are indicated ones plus these moves: the nominal machine has there the
        pose that the real one has, its direction as far as the axes in `turning` can.

        Parameters
        ----------
        positions, directions
            As in `step`.
        """
        return self._pose(positions, directions)

    def errors(self, positions: F64, directions: F64 | None = None) -> F64:
        """Errors at n points, positions (n, k) in mm or rad → (n, 3), mm, as moves of X, Y, Z.

        Directions as in `step`, (n, k); None: all 0. Other shapes raise `InputError`.
        """
        rows = np.asarray(positions, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.axes):
            raise InputError(
                "positions of the wrong shape",
                field="positions",
                found=rows.shape,
                expected=f"(n, {len(self.axes)}) for {', '.join(self.axes)}",
            )
        if directions is None:
            moved = np.broadcast_to(0.0, rows.shape)
        else:
            moved = np.asarray(directions, dtype=np.float64)
            if moved.shape != rows.shape:
                raise InputError(
                    "directions of the wrong shape",
                    field="directions",
                    found=moved.shape,
                    expected=str(rows.shape),
                )
        if len(rows) <= _FEW or self._waiting:
            step = self._step
            pairs = zip(rows.tolist(), moved.tolist(), strict=True)
            return np.array([step(p, d) for p, d in pairs]).reshape(-1, 3)
        return self._batch.errors(rows, moved)

    def command(
        self, target: F64, directions: F64 | None = None, *, tolerance: float = 1e-10
    ) -> Inverse:
        """What to command so that the functional point really gets to a target.

        Solves ``c + error(c) = target`` by the fixed point ``c → target − error(c)``.

        Parameters
        ----------
        target
            Shape (n, k) in the order of `axes`, mm or rad; rotary axes (and linear ones beside
            X, Y, Z) are held.
        directions
            Directions of arrival, as in `errors`.
        tolerance
            mm: greatest distance of the result from the solution.

        Returns
        -------
        Its positions in the order of `axes`; its contraction factor proves, below 1, that the
        iteration converges to the one solution.

        Raises
        ------
        NotContractionError
            Where the error's slope reaches 1; names the point and the factor.
        """
        rows = np.atleast_2d(np.asarray(target, dtype=np.float64))
        carrying = [self.axes.index(a) for a in self._carrying]
        moves = ["XYZ".index(a) for a in self._carrying]
        order = [*carrying, *(i for i in range(len(self.axes)) if i not in carrying)]
        back = np.argsort(order)
        found = invert(
            lambda x: self.errors(x[:, back], directions)[:, moves],
            rows[:, order],
            tolerance=tolerance,
            letters=self._carrying,
        )
        return replace(found, positions=found.positions[:, back])

    def _reach(self, tool: Triple) -> float:
        longest = max(np.ptp(self.model.machine.axis(a).travel) for a in self._carrying)
        return max(1.01 * math.hypot(*tool), _REACH * float(longest))

    def _turn_tool(self) -> None:
        """Find out what the tool's offset does to the levers."""
        machine, error_motions = self.model.machine, self._fold.error_motions
        count = len(self.axes)
        first = self.model.composition == "first-order"
        where = np.concatenate([np.zeros((1, count)), _FAR * np.eye(count)])
        rows = {a: where[:, i] for i, a in enumerate(self.axes)}
        self._linear: tuple[F64, F64] | None = None
        self._nine: F64 | None = None
        if first and not machine.structure.rotary:
            moves = influences(machine, error_motions, self._state.conditions(rows, {}))
            moves[:, [k for k, a in enumerate("XYZ") if a not in self._carrying]] = 0.0
            per_mm = (moves[1:] - moves[0]) / _FAR
            per_mm[np.abs(per_mm) < _NO_LEVER] = 0.0
            self._linear = moves[0], per_mm
            self._nine = nine(moves[0], per_mm, self.axes)

    def _renew(self) -> None:
        """Fold anew and put the new tables in the place of the old ones, at once."""
        if not self._fold.refresh(self._state):
            self._fold.lay_out(self._state, seen=True)
            self._fold.refresh(self._state)
        model, tables, state = self.model, self._fold.tables, self._state
        if self._linear is not None:
            self._batch: LinearBatch | ChainBatch = LinearBatch(tables, *self._linear)
        else:
            self._batch = ChainBatch(model.machine, model.composition, tables, state)
        if self._nine is not None:
            self._step = cartesian_step(tables, self._nine, self.axes)
        elif len(self._carrying) < len("XYZ"):
            self._step = few_axes_step(model.machine, model.composition, tables, state)
        else:
            self._step = general_step(model.machine, model.composition, tables, state)
        if self.turning:
            self._pose = pose_step(model.machine, model.composition, tables, state, self.turning)

    def _no_pose_yet(self, positions: Sequence[float], directions: Sequence[float]) -> PoseError:
        if not self.turning:
            raise InputError("no rotary axis is corrected", field="turning", expected="their names")
        raise self._unknown()

    def _not_yet(self, positions: Sequence[float], directions: Sequence[float]) -> Triple:
        raise self._unknown()

    def _unknown(self) -> InputError:
        return InputError(
            "the model's signals are not known yet",
            expected="a first update with " + (", ".join(self.signals) or "the time"),
        )
