"""The external offset of one of LinuxCNC's axes, moved and watched through HAL.

An external offset is moved by *changes* of ``axis.L.eoffset-counts`` and zeroed by LinuxCNC at
machine-on; what the offset really is, ``eoffset-request`` tells. So counts are set relative to a
pair (counts, request) that was seen, and the pair is taken anew when the two no longer agree.

Run by the system's Python, as `abbe.drivers.linuxcnc.bridge` is: imports nothing of Abbe.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

ANSWER_TIME = 0.02
"""s in which the servo thread takes up changed counts: twenty of its usual periods."""
PAUSE = 0.2
"""s for which a busy computer may keep the servo thread waiting before it takes counts up."""


class Offset:
    """The external offset of one axis.

    Parameters
    ----------
    hal
        LinuxCNC's module.
    axis
        Letter, lower case.
    scale
        Step: mm (degrees) per count.
    largest
        Most that is ever asked for, mm (degrees).
    units
        Machine units per mm (degree).
    taken_in
        Until when (monotonic, s) LinuxCNC's servo thread has surely taken in what was asked for.

    Attributes
    ----------
    lease_ends
        When it is taken back if nobody sets it again (monotonic, s); None: it is zero, or nobody's.
    changed_at
        When LinuxCNC was last asked for another one (monotonic, s).
    ramp
        When taking it back began, and from where; None: it is not taken back.
    """

    def __init__(
        self,
        hal: Any,
        axis: str,
        scale: float,
        largest: float,
        units: float,
        taken_in: Callable[[], float],
    ) -> None:
        self._hal = hal
        self._taken_in = taken_in
        self._pin = "axis." + axis + ".eoffset"
        self.step = scale
        self._largest = largest
        self.changed_at = 0.0
        self.wanted = 0.0
        self.lease_ends: float | None = None
        self.ramp: tuple[float, float] | None = None
        self._get = hal.get_value
        self._units = units
        hal.set_p(self._pin + "-scale", repr(scale * units))
        hal.set_p(self._pin + "-enable", "1")
        self._base = (self._get(self._pin + "-counts"), self.request)
        self.wanted = self.request

    @property
    def request(self) -> float:
        """What LinuxCNC takes the offset to be, mm (degrees)."""
        return float(self._get(self._pin + "-request")) / self._units

    @property
    def applied(self) -> float:
        """How much of it is applied: on its way, or held back by a soft limit."""
        return float(self._get(self._pin)) / self._units

    def check(self, offset: float) -> None:
        """Raise ValueError when an offset is too large, or no number."""
        if not abs(offset) <= self._largest:
            raise ValueError(
                f"{self._pin}: {offset:g} is beyond the largest allowed, {self._largest:g}"
            )

    def want(self, offset: float) -> None:
        """Ask for an offset; raises as `check`."""
        self.check(offset)
        self.wanted = offset
        self._rebase_if_moved()
        counts, request = self._base
        new = counts + round((offset - request) / self.step)
        if new != self._get(self._pin + "-counts"):
            self._hal.set_p(self._pin + "-counts", str(new))
            self.changed_at = time.monotonic()

    @property
    def settled(self) -> bool:
        """Whether LinuxCNC took up what is wanted."""
        return abs(self.request - self.wanted) <= 0.6 * self.step

    @property
    def missing(self) -> float:
        """How far what is applied is from what is wanted."""
        return abs(self.applied - self.wanted)

    def _rebase_if_moved(self) -> None:
        """Take the pair anew when something else moved the offset (machine-on, clear).

        Not before the servo thread has taken in the last counts, however long it pauses: the same
        offset would be added again with every write.
        """
        if time.monotonic() - self.changed_at < ANSWER_TIME:
            return
        if self._taken_in() <= self.changed_at:
            return
        counts, request = self._base
        now = self._get(self._pin + "-counts")
        expected = request + (now - counts) * self.step
        if abs(self.request - expected) > 0.5 * self.step:
            self._base = (now, self.request)
