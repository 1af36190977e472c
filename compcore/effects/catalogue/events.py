"""Effects of time: warm-up, drift, and an event at a moment that is found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import Motion, NonlinearParameter, Parameter
from abbe.compcore.effects.keys import FittedUnlessGiven, PositiveUnlessFitted
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import ShiftEffect, shift_targets
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine

_DAY = 86_400.0


@register
class WarmUp(ShiftEffect):
    """Warm-up: after switch-on the machine creeps to its steady state (ISO 230-3, ETVE).

    Formula
        ``d = A·(1 − e^(−t/τ))``, t in s since the clock's start, which is the start of the campaign
        or of the daemon; for t < 0 nothing. A switch-on before that changes A only, and a constant
        that the set-ups' zeros take up.
    Parameters
    ----------
        A in mm (rad for a rotary axis), the whole way, within ±0.2 mm (500 µrad): 5 to 50 µm for
        spindles and drives. tau in s, fitted unless given; 10 minutes for a spindle, 1 to 3 hours
        for a column, half a day for a bed.
    Signals
        None but the time; where a temperature tells the same, `thermal_offset` is the better
        effect, since it also holds when the machine cools.
    Typical causes
        Drives, spindle, hydraulics and electronics that warm after switch-on.
    Cure
        A warm-up cycle before work (and before measuring); heat kept constant overnight; a sensor
        on the body that warms.
    Source
        ISO 230-3 (environmental temperature variation error, warm-up); Bryan, CIRP Annals 39/2
        (1990), 645-656.
    """

    kind = "warm_up"
    of_the_clock = True
    tau: PositiveUnlessFitted = None

    def of_its_day(self) -> bool:
        """A machine warms up every day."""
        return False

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The whole way."""
        error_motion = self.error_motion()
        most = 5e-4 if error_motion.rotation else 0.2
        return (Parameter("A", error_motion.unit, (-most, most), f"warm-up of {error_motion}"),)

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """The time constant unless it is given."""
        return () if self.tau is not None else (_time_constant(20_000.0),)

    def search(self, machine: Machine, coverage: Coverage) -> tuple[NonlinearParameter, ...]:
        """Time constants that the campaign is long enough to show."""
        if self.tau is not None or coverage.duration <= 0.0:
            return self.nonlinear(machine)
        return (_time_constant(coverage.duration),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``1 − e^(−t/τ)`` on the shift."""
        tau = nonlinear["tau"] if self.tau is None else self.tau
        risen = -np.expm1(-np.clip(conditions.time, 0.0, None) / tau)
        return (Motion(self.error_motion(), risen[:, None]),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[WarmUp]:
        """Each direction, and axes that are not fixed to one, in a campaign that took time."""
        if coverage.duration > 0.0:
            for target in shift_targets(machine):
                yield cls.model_validate(target)


def _time_constant(duration: float) -> NonlinearParameter:
    longest = max(2.0 * duration, 600.0)
    starts, tau = [], 60.0
    while tau < longest:
        starts.append(tau)
        tau *= 1.6
    return NonlinearParameter(
        "tau", "s", (10.0, longest), tuple(starts), (60.0, 1e5), "time constant of the warm-up"
    )


@register
class Drift(ShiftEffect):
    """Drift: a shift that grows evenly with time, of no cause that a recorded signal shows.

    Formula
        ``d = rate·t``, t in s since the clock's start. Fitted so that it does not spoil other
        effects; as a prediction it holds only within the campaign's own time.
    Parameters
    ----------
        rate in mm/s (rad/s for a rotary axis), within ±50 µm/h (±100 µrad/h): more is a loose part
        or an instrument.
    Signals
        None but the time.
    Typical causes
        Slow temperature change of something without a sensor: foundation, hall, hydraulic oil;
        settling after transport; leaking hydrostatics.
    Cure
        Find the cause: more sensors, longer recording. A master point revisited tells a drift of
        the machine from one of a single set-up (`instrument_drift`).
    Source
        ISO 230-3 (environmental temperature variation error); ISO/TR 16907:2015, 8.3.
    """

    kind = "drift"
    of_the_clock = True

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The speed of the drift."""
        error_motion = self.error_motion()
        most = (1e-4 if error_motion.rotation else 0.05) / 3600.0
        return (
            Parameter("rate", f"{error_motion.unit}/s", (-most, most), f"drift of {error_motion}"),
        )

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``t`` on the shift."""
        return (Motion(self.error_motion(), conditions.time[:, None]),)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Drift]:
        """Each direction, and axes that are not fixed to one, in a campaign that took time."""
        if coverage.duration > 0.0:
            for target in shift_targets(machine):
                yield cls.model_validate(target)


@register
class Event(ShiftEffect):
    """Event: at one moment the machine stands elsewhere and stays there.

    ``number`` tells several events of one direction apart: 2, 3, … up to 9, in no order of time.

    Formula
        ``d = step`` for t ≥ t0, before it 0; t0 in s on the campaign's clock. With several
        campaigns in one fit the moment is that of each one's own clock.
    Parameters
    ----------
        step in mm (rad for a rotary axis), within ±0.2 mm (500 µrad). t0 in s, fitted unless given;
        it is known to within the pause between two measurements.
    Signals
        None but the time.
    Typical causes
        A collision, a lost reference or a new homing (one count of the reference mark, one turn of
        the encoder), a clamp that slipped, a power cut, a tool or probe that was changed.
    Cure
        Home again and measure again; look into the machine's log at t0. In the model the step is
        kept as long as the campaign is used, so that both parts of it count.
    Source
        ISO/TR 16907:2015, 8.3 and 11 (repeatability bounds what is reached); common practice.
    """

    kind = "event"
    of_the_clock = True
    t0: FittedUnlessGiven = None
    number: Annotated[int, Field(ge=2, le=9)] | None = None

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The step."""
        error_motion = self.error_motion()
        most = 5e-4 if error_motion.rotation else 0.2
        return (Parameter("step", error_motion.unit, (-most, most), f"step of {error_motion}"),)

    def nonlinear(self, machine: Machine) -> tuple[NonlinearParameter, ...]:
        """The moment unless it is given."""
        return () if self.t0 is not None else (_moment(_DAY),)

    def search(self, machine: Machine, coverage: Coverage) -> tuple[NonlinearParameter, ...]:
        """Moments within the campaign."""
        if self.t0 is not None or coverage.duration <= 0.0:
            return self.nonlinear(machine)
        return (_moment(coverage.duration),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """1 from t0 on."""
        t0 = nonlinear["t0"] if self.t0 is None else self.t0
        after = (conditions.time >= t0).astype(np.float64)
        return (Motion(self.error_motion(), after[:, None]),)

    def next_one(self) -> Event | None:
        """Another event in the same direction, at a moment of its own."""
        following = (self.number or 1) + 1
        return self.model_copy(update={"number": following}) if following <= 9 else None

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[Event]:
        """Each direction, and axes that are not fixed to one, in a campaign that took time.

        Not in several campaigns at once: no collision comes at the same hour of each.
        """
        if coverage.duration > 0.0 and coverage.runs == 1:
            for target in shift_targets(machine):
                yield cls.model_validate(target)


def _moment(duration: float) -> NonlinearParameter:
    starts = tuple(float(t) for t in np.linspace(0.0, duration, 130)[1:-1])
    return NonlinearParameter(
        "t0",
        "s",
        (0.0, duration),
        starts,
        (0.0, duration),
        "the moment of the step",
        smooth=False,
    )
