"""The bridge to a running LinuxCNC for tables: its state, pins, small moves.

Run by the system's Python as `abbe.drivers.linuxcnc.bridge` is, with the same first argument and
line JSON on its pipes; sets no offsets. Besides ``{"read": […]}`` it answers

``{"state": true}``
    ``{"ini": …, "on": …, "idle": …, "homed": [true, …], "in_position": …, "units_per_mm": …,
    "limits": {"X": [-300.0, 300.0], …}, "position": {"X": 0.0, …}, "mode": …, "command": …}``;
    soft limits and machine coordinates of the axes, in machine units; `command` is the number of
    the last command that LinuxCNC received from anybody
``{"move": {"axis": "X", "to": 12.5, "feed": 300.0}}``
    ``{"moving": true, "command": …}``; the position in machine coordinates, both in mm (degrees);
    returns before it is there. `command` is the number of its last command
``{"mode": 1}``
    ``{"mode": 1}``; as `state` tells it

A move leaves the modal state (units, distance mode, feed, offsets) as it was.
"""

from __future__ import annotations

import sys
from typing import Any

from bridge import Bridge, run  # type: ignore[import-not-found]  # the file beside this one

_MODE_TIME = 5.0
"""s for LinuxCNC to change its mode."""


class TableBridge(Bridge):  # type: ignore[misc]
    """The bridge's commands for the store."""

    def attach(self) -> None:
        """Become part of HAL, and of LinuxCNC's commands."""
        super().attach()
        import linuxcnc

        self._linuxcnc = linuxcnc
        self._status = linuxcnc.stat()
        self._command = linuxcnc.command()

    def answer(self, order: dict[str, Any]) -> None:
        """Carry out one order."""
        if "state" in order:
            self.say(**self._state())
        elif "move" in order:
            self.say(**self._move(**order["move"]))
        elif "mode" in order:
            self._enter(order["mode"])
            self.say(mode=order["mode"])
        else:
            super().answer(order)

    def _state(self) -> dict[str, Any]:
        status, names = self._status, self._linuxcnc
        status.poll()
        joints = range(status.joints)
        axes = [(i, a) for i, a in enumerate("XYZABCUVW") if status.axis_mask >> i & 1]
        return {
            "ini": status.ini_filename,
            "on": status.task_state == names.STATE_ON,
            "idle": status.interp_state == names.INTERP_IDLE
            and status.exec_state == names.EXEC_DONE
            and status.queue == 0,
            "in_position": bool(status.inpos),
            "homed": [bool(status.homed[j]) for j in joints],
            "units_per_mm": status.linear_units,
            "limits": {
                a: [status.axis[i]["min_position_limit"], status.axis[i]["max_position_limit"]]
                for i, a in axes
            },
            "position": {a: status.position[i] for i, a in axes},
            "mode": status.task_mode,
            "command": status.echo_serial_number,
        }

    def _enter(self, mode: int) -> None:
        self._status.poll()
        if self._status.task_mode != mode:
            self._command.mode(mode)
            self._command.wait_complete(_MODE_TIME)

    def _move(self, axis: str, to: float, feed: float) -> dict[str, Any]:
        state = self._state()
        if not (state["on"] and state["idle"] and all(state["homed"])):
            return {"failed": "the machine is off, busy or not homed: it is not moved"}
        self._enter(self._linuxcnc.MODE_MDI)
        # M70 and M72 save and restore the modal state. Units have a line of their own: F is taken
        # before them in the same one.
        for line in ("M70", "G21 G90 G94 G40", f"G53 G1 {axis}{to:.6f} F{feed:.6f}", "M72"):
            self._command.mdi(line)
        return {"moving": True, "command": self._command.serial}


if __name__ == "__main__":
    sys.exit(run(TableBridge))
