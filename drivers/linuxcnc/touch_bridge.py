"""The bridge to a running LinuxCNC for its touch probe: straight moves, ``G38.2``, turns, stops.

Run by the system's Python as `abbe.drivers.linuxcnc.bridge` is, with the same first argument and
line JSON on its pipes; sets no offsets. Places are the tip's in machine coordinates, mm: axes less
the tool offset that acts (``G43``). Orders:

``{"begin": true}``
    ``{"begun": true}``; from now on nobody else may tell LinuxCNC anything, and the tool stays
``{"tip": true}``
    ``{"tip": [x, y, z]}``
``{"go": {"to": [x, y, z], "feed": mm/min, "touching": false}}``
    ``{"from": {…}}``, where it is, as ``how`` has it; `touching`: the probe may be in contact
``{"touch": {"to": [x, y, z], "feed": …}}``
    the same, by ``G38.2``
``{"turn": {"to": {"C": degrees}, "feed": degrees/min}}``
    the same
``{"how": true}``
    ``{"on": …, "idle": …, "tip": […], "axes": [nine positions], "off": …, "tripped": …, "touched":
    […], "met": …, "astray": …, "others": …}``: whether the machine is on, nothing moves; where it
    is, and how far from the move's end, mm or degrees; whether and where the probe tripped last;
    whether it was in contact at some look; how far the tip was from its line when it was halted for
    that; whether somebody else has told LinuxCNC something
``{"done": true}``
    ``{"done": true}``; the modal state (units, feed, …) is again what it was before the move
``{"halt": true}``
    ``{"halted": true}``: LinuxCNC aborts what it does

A move that is not allowed is ``failed``, with its reason; nothing was begun. Only soft limits of
LinuxCNC are known here; what may be entered is looked at before. A tip that leaves its straight
line by more than `ASTRAY` is halted; so is a move under way when whoever ordered it is gone.
"""

from __future__ import annotations

import math
import sys
import time
from typing import Any

from bridge import Bridge, run  # type: ignore[import-not-found]  # the file beside this one

ASTRAY = 0.5
"""mm from its line at which a tip is halted."""
_ACCEPTED = 5.0
"""s for LinuxCNC to take an order up."""
_BETWEEN = 0.005
"""s between two looks whether an order is read."""
_EXPLAINED = 0.3
"""s within which an order of somebody else's shows as a changed override; else it is another."""
_LINEAR, _ROTARY = "XYZ", "ABC"
_LETTERS = "XYZABCUVW"
_PLAIN = "G21 G90 G94 G40 G8"
"""mm, absolute, feed a minute, no cutter compensation, no diameters."""


class TouchBridge(Bridge):  # type: ignore[misc]
    """The bridge's commands for the probe."""

    def attach(self) -> None:
        """Become part of HAL, and of LinuxCNC's commands."""
        super().attach()
        import linuxcnc

        self._linuxcnc = linuxcnc
        self._status = linuxcnc.stat()
        self._command = linuxcnc.command()
        self._tool: list[float] = []
        self._kind = ""
        """The move under way: go, touch, turn; empty for none."""
        self._to: Any = []
        self._from: list[float] = []
        self._met, self._astray = False, 0.0
        self._known()

    def serve(self) -> None:
        """Answer; whoever ends, a move that is under way is aborted."""
        try:
            super().serve()
        finally:
            if self._kind:
                self._command.abort()

    def answer(self, order: dict[str, Any]) -> None:
        """Carry out one order."""
        self._status.poll()
        moves = [kind for kind in ("go", "touch", "turn") if kind in order]
        if moves:
            self.say(**self._move(moves[0], **order[moves[0]]))
        elif "how" in order:
            self.say(**self._how())
        elif "begin" in order:
            self._tool = self._offset()
            self._known()
            self.say(begun=True)
        elif "tip" in order:
            self.say(tip=self._tip())
        elif "done" in order:
            self._kind = ""
            self._mdi("M72")
            self.say(done=True)
        elif "halt" in order:
            self._kind = ""
            self._command.abort()
            self.say(halted=True)
        else:
            super().answer(order)

    # where it is

    @property
    def _units(self) -> float:
        return float(self._status.linear_units)

    def _offset(self) -> list[float]:
        return [v / self._units for v in self._status.tool_offset[:3]]

    def _tip_of(self, axes: list[float]) -> list[float]:
        return _less([v / self._units for v in axes[:3]], self._offset())

    def _tip(self) -> list[float]:
        return self._tip_of(self._status.position)

    def _touching(self) -> bool:
        return bool(self._hal.get_value("motion.probe-input"))

    def _idle(self) -> bool:
        status, names = self._status, self._linuxcnc
        return (
            status.interp_state == names.INTERP_IDLE
            and status.exec_state in (names.EXEC_DONE, names.EXEC_ERROR)
            and status.queue == 0
            and bool(status.inpos)
        )

    # who else there is

    def _known(self) -> None:
        """Take what LinuxCNC was told until now as known."""
        self._status.poll()
        self._serial, self._overrides = self._status.echo_serial_number, self._overridden()
        self._unexplained: float | None = None

    def _overridden(self) -> tuple[float, ...]:
        """What an operator may change while it moves."""
        status = self._status
        spindles = (s["override"] for s in status.spindle[: status.spindles])
        return (status.feedrate, status.rapidrate, status.max_velocity, *spindles)

    def _told_by_others(self, *, wait: bool) -> bool:
        """Whether somebody has told LinuxCNC something, but for overrides.

        Parameters
        ----------
        wait
            Whether to wait until that is known; else it is found a little later.
        """
        while self._status.echo_serial_number > self._serial:
            now = time.monotonic()
            if self._overridden() != self._overrides:
                self._known()
                return False
            self._unexplained = self._unexplained or now
            if now - self._unexplained > _EXPLAINED:
                return True
            if not wait:
                return False
            time.sleep(0.01)
            self._status.poll()
        return False

    # a move begins

    def _hindrance(self, kind: str, to: Any, feed: float, *, touching: bool = False) -> str:
        """Why a move is not begun; empty when nothing speaks against it."""
        status = self._status
        reasons = (
            (status.task_state != self._linuxcnc.STATE_ON, "the machine is off"),
            (not all(status.homed[: status.joints]), "the machine is not homed"),
            (not self._idle(), "LinuxCNC is busy"),
            (any(s["enabled"] for s in status.spindle[: status.spindles]), "the spindle turns"),
            (bool(self._hal.get_value("motion.eoffset-active")), "an external offset acts"),
            (
                not self._hal.pin_has_writer("motion.probe-input"),
                "nothing is connected to motion.probe-input",
            ),
            (self._touching() and not touching, "the probe touches something already"),
            (math.dist(self._tool, self._offset()) > 1e-6, "another tool offset acts than before"),
            (self._told_by_others(wait=True), "somebody else has told LinuxCNC something"),
            (not 0.0 < feed < math.inf, f"a feed of {feed}"),
        )
        for holds, words in reasons:
            if holds:
                return words
        for axis, value in self._axes(kind, to).items():
            i = _LETTERS.index(axis)
            if not status.axis_mask >> i & 1:
                return f"LinuxCNC has no axis {axis}"
            unit = 1.0 if axis in _ROTARY else self._units
            own = status.axis[i]
            low, high = own["min_position_limit"] / unit, own["max_position_limit"] / unit
            if not low <= value <= high:
                return f"{axis} {value:.3f} is beyond LinuxCNC's soft limits {low:g} … {high:g}"
        return ""

    def _axes(self, kind: str, to: Any) -> dict[str, float]:
        """Where axes shall go, mm or degrees."""
        if kind == "turn":
            return dict(to)
        pairs = zip(_LINEAR, to, self._offset())  # noqa: B905 - any Python 3
        return {axis: value + own for axis, value, own in pairs}

    def _move(self, kind: str, to: Any, feed: float, *, touching: bool = False) -> dict[str, Any]:
        why = self._hindrance(kind, to, feed, touching=touching)
        if why:
            return {"failed": why}
        if self._status.task_mode != self._linuxcnc.MODE_MDI:
            self._command.mode(self._linuxcnc.MODE_MDI)
            self._command.wait_complete(_ACCEPTED)
        # M70 and M72 save and restore the modal state. Units have a line of their own: F is taken
        # before them in the same one.
        self._mdi("M70")
        self._mdi(_PLAIN)
        if kind == "touch":
            word = "G38.2"
            axes = dict(zip(_LINEAR, self._in_program(to)))  # noqa: B905 - any Python 3
        else:
            word, axes = "G53 G1", self._axes(kind, to)
        self._kind, self._to, self._from = kind, to, self._tip()
        self._met, self._astray = False, 0.0
        words = " ".join(f"{axis}{value:.6f}" for axis, value in axes.items())
        began = self._how()
        self._command.mdi(f"{word} {words} F{feed:.6f}")
        self._serial, self._unexplained = self._command.serial, None
        return {"from": began}

    def _mdi(self, line: str) -> None:
        """A line without a move; what is ordered while LinuxCNC still reads one can be lost."""
        self._command.mdi(line)
        self._command.wait_complete(_ACCEPTED)
        end = time.monotonic() + _ACCEPTED
        while time.monotonic() < end:
            self._status.poll()
            if self._idle():
                break
            time.sleep(_BETWEEN)
        self._serial, self._unexplained = self._command.serial, None

    def _in_program(self, tip: list[float]) -> list[float]:
        """The program's coordinates of a place, mm: G38.2 knows no G53."""
        status, unit = self._status, self._units
        x, y, z = _less(tip, [v / unit for v in status.g5x_offset])
        turn = math.radians(status.rotation_xy)
        x, y = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
        return _less([x, y, z], [v / unit for v in status.g92_offset])

    # while it moves

    def _watch(self) -> None:
        super()._watch()
        if self._kind not in ("go", "touch"):
            return
        self._met = self._met or self._touching()
        self._status.poll()
        away = _from_line(self._tip(), self._from, self._to)
        if away > ASTRAY and not self._astray:
            self._command.abort()
            self._astray = away

    def _how(self) -> dict[str, Any]:
        status = self._status
        if self._kind == "turn":
            at = (abs(status.position[_LETTERS.index(a)] - v) for a, v in self._to.items())
            off = max(at)
        else:
            off = math.dist(self._tip(), self._to) if self._kind else 0.0
        return {
            "on": status.task_state == self._linuxcnc.STATE_ON,
            "idle": self._idle(),
            "tip": self._tip(),
            "axes": list(status.position),
            "off": off,
            "tripped": bool(status.probe_tripped),
            "touched": self._tip_of(status.probed_position),
            "met": self._met,
            "astray": self._astray,
            "others": self._told_by_others(wait=False),
        }


def _less(one: list[float], other: list[float]) -> list[float]:
    return [a - b for a, b in zip(one, other)]  # noqa: B905 - any Python 3


def _from_line(place: list[float], start: list[float], end: list[float]) -> float:
    """How far a place is from a piece of a straight line."""
    along, own = _less(end, start), _less(place, start)
    length = math.hypot(*along)
    if length == 0.0:
        return math.hypot(*own)
    part = sum(a * b for a, b in zip(own, along)) / length**2  # noqa: B905 - any Python 3
    part = min(max(part, 0.0), 1.0)
    return math.dist(own, [part * v for v in along])


if __name__ == "__main__":
    sys.exit(run(TouchBridge))
