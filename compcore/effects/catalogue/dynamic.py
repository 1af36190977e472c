"""Dynamic effects: what the speed does to the recorded position."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import Effect, Motion, Parameter
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.signals import recorded
from abbe.compcore.effects.targets import along, require_linear
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine

SPEEDS = {"mm/s": 1.0, "mm/min": 1.0 / 60.0, "m/min": 1000.0 / 60.0, "m/s": 1000.0}
"""Unit of a feed → its factor to mm/s."""

_SHORTEST = 2e-5
"""s: less than any cycle of a control or a latch that people notice."""


@register
class FeedLag(Effect):
    """Feed lag: measured on the fly, the machine is not where it is recorded.

    Between the moment at which the position is read and the moment at which it holds lies a delay,
    and a servo follows its command late. Both displace the point along the motion, in proportion to
    speed, and change sides with it.

    Formula
        ``E_aa = delay·feed·s_a``, feed in mm/s, s_a the direction of motion (+1, −1; 0 at rest).
    Parameters
    ----------
        delay in s: positive where the machine is further on than recorded (the position was latched
        too early), negative where it trails. Within ±0.1 s: a servo with K_v = 1 m/min per mm
        trails by 60 ms, latching alone is below 5 ms.
    Signals
        The feed along the axis, in mm/min, mm/s, m/min or m/s, and the axis's direction.
    Typical causes
        Following error read as position, unequal servo gains, a trigger (probe, laser) with a
        delay, filters in the encoder's interface.
    Cure
        Measure and probe at one slow feed, latch by hardware, feed-forward, matched gains.
    Source
        ISO 230-4 (circular tests at two feeds); ISO 10791-6 for the servo's lag.
    """

    kind = "feed_lag"
    axis: str
    signal: str

    def check(self, machine: Machine) -> None:
        """Linear axes, and a signal that is a speed."""
        super().check(machine)
        require_linear(machine, self.axis, self.kind)
        unit = machine.signals[self.signal].unit
        if unit not in SPEEDS:
            raise InputError(
                "not a feed",
                field="signal",
                found=f"{self.signal} in {unit}",
                expected="a signal in " + ", ".join(SPEEDS),
            )

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The delay."""
        return (Parameter("delay", "s", (-0.1, 0.1), f"delay of {self.axis}"),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``feed·s_a`` on E_aa."""
        feed = conditions.signal(self.signal) * SPEEDS[machine.signals[self.signal].unit]
        column = feed * conditions.direction(self.axis)
        return (Motion(along(self.axis), column[:, None]),)

    def misnamed(self, values: Mapping[str, float]) -> bool:
        """Whether the delay is shorter than anything that a control does in time.

        Then the feed, recorded while the machine stood, is the heat of its strokes.
        """
        return abs(values["delay"]) < _SHORTEST

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """None."""
        return ()

    def directions_used(self) -> tuple[str, ...]:
        """The axis itself."""
        return (self.axis,)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[FeedLag]:
        """Each axis that moved both ways with each recorded feed, its own first."""
        feeds = [s for s in recorded(machine, coverage) if s.unit in SPEEDS]
        for axis in machine.structure.linear:
            if axis in coverage.moving and axis in coverage.reversing:
                for feed in sorted(feeds, key=lambda s: s.axis != axis):
                    if feed.axis in (None, axis):
                        yield cls(axis=axis, signal=feed.name)
