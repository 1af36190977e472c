"""The bridge to a running LinuxCNC: run by the system's Python, line JSON on its pipes.

LinuxCNC's modules ``linuxcnc`` and ``hal`` belong to the system's Python (Debian: /usr/bin/python3)
and not to a virtual environment. So this file is run there, in a process of its own; it imports
the file beside it, nothing else that is not in the standard library, and nothing of Abbe.

Started with one argument, a JSON object: ``offsets`` (axis letter → ``scale``, its step, and
``max``, both in mm or degrees), ``lease``, ``ramp``, ``servo_silence`` (s). Says ``{"ready": …}``
or ``{"error": …}`` first; then one answer for each line, with the same ``id``:

``{"id": 1, "read": ["joint.0.pos-fb", "no"]}``
    ``{"id": 1, "values": [50.0, null], "why": {"no": "pin not found"}, "at": …}``; `at` is the
    moment (CLOCK_MONOTONIC, s) since which the servo thread has gone on: the values are no older
``{"id": 2, "set": {"x": 0.0123}, "until": …}``
    ``{"id": 2, "set": {"x": {"request": …, "applied": …}}, "limited": false, "why": ""}``; or
    ``{"id": 2, "late": true}`` when it is later than `until` (CLOCK_MONOTONIC, s): nothing was set

An offset that Abbe does not set again for ``lease`` s, and all of them when it is gone, are taken
back to zero within ``ramp`` s. When the servo thread stands still for ``servo_silence`` s (LinuxCNC
was killed), this process ends.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from abbe.drivers.linuxcnc.external_offset import ANSWER_TIME, PAUSE, Offset
else:
    from external_offset import ANSWER_TIME, PAUSE, Offset  # run as a script, beside that file

HAL_KEY = 0x48414C32
"""Of HAL's shared memory (hal_priv.h). Attaching to what is not there would create it."""
NAP = 0.005
"""s between two looks at the servo thread: a value may be younger than stated by so much."""
AT_THE_END = 2.0
"""s for which the end waits for LinuxCNC to take back an offset that it has not taken up."""


class GoneError(Exception):
    """LinuxCNC is not running, or no longer; the message says how that shows."""


def running() -> bool:
    """Whether HAL's shared memory exists and somebody is attached to it."""
    rows = [line.split() for line in Path("/proc/sysvipc/shm").read_text().splitlines()]
    key, attached = rows[0].index("key"), rows[0].index("nattch")
    return any(int(row[key]) & 0xFFFFFFFF == HAL_KEY and int(row[attached]) > 0 for row in rows[1:])


class Bridge:
    """The bridge's commands for the link.

    Parameters
    ----------
    settings
        As in the module's description.
    out
        File descriptor to answer on.
    """

    def __init__(self, settings: dict[str, Any], out: int) -> None:
        self._settings = settings
        self._out = out
        self._ending = False
        self._id: int | None = None
        self._beat = (0.0, time.monotonic())
        self._looked = self._fresh = self._taken_in = time.monotonic()
        self._offsets: dict[str, Offset] = {}

    def say(self, **facts: Any) -> None:
        """Write one line, the answer to the order that is being carried out."""
        if self._id is not None:
            facts["id"] = self._id
        try:
            os.write(self._out, json.dumps(facts).encode() + b"\n")
        except BrokenPipeError:
            self._ending = True

    def attach(self) -> None:
        """Become part of HAL."""
        if not running():
            raise GoneError("LinuxCNC is not running")
        import hal
        import linuxcnc

        status = linuxcnc.stat()
        try:
            status.poll()
        except linuxcnc.error as error:
            raise GoneError(f"LinuxCNC is not running ({error})") from None
        if not status.ini_filename:
            raise GoneError("LinuxCNC is starting")
        self._component = hal.component(f"abbe-{os.getpid()}")
        self._component.ready()
        if not hal.component_exists("motmod"):
            raise GoneError("LinuxCNC is starting: no motion module yet")
        self._hal = hal
        ini = linuxcnc.ini(status.ini_filename)
        ratios = {
            axis: float(ini.find("AXIS_" + axis.upper(), "OFFSET_AV_RATIO") or 0.0)
            for axis in self._settings["offsets"]
        }
        off = [axis for axis, ratio in ratios.items() if not ratio > 0.0]
        if off:
            raise ValueError(
                f"[AXIS_{off[0].upper()}] of {status.ini_filename} has no OFFSET_AV_RATIO: "
                "LinuxCNC takes no external offset there"
            )
        # A LinuxCNC that was killed leaves its memory behind, in which nothing moves any more.
        deadline = time.monotonic() + self._settings["servo_silence"]
        first = self._period()
        while self._period() == first:
            if time.monotonic() > deadline:
                raise GoneError("LinuxCNC's servo thread stands still (was it killed?)")
            time.sleep(0.002)
        self._offsets = {
            axis: Offset(
                hal,
                axis,
                part["scale"],
                part["max"],
                1.0 if axis in "abc" else status.linear_units,
                lambda: self._taken_in,
            )
            for axis, part in self._settings["offsets"].items()
        }
        self.say(
            ready={
                "ini": status.ini_filename,
                "units_per_mm": status.linear_units,
                "ratios": ratios,
            }
        )

    def _period(self) -> float:
        return float(self._hal.get_value("motion.servo.last-period"))

    def read(self, names: list[str]) -> dict[str, Any]:
        """Values of pins or signals, why some cannot be read, and since when they are."""
        self._look()
        at, get = self._fresh, self._hal.get_value
        values: list[float | None] = []
        why = {}
        for name in names:
            try:
                values.append(float(get(name)))
            except RuntimeError as error:
                values.append(None)
                why[name] = str(error)
        return {"values": values, "why": why, "at": at}

    def set(self, wanted: dict[str, float], until: float) -> dict[str, Any]:
        """Move offsets, not after `until`, and see whether LinuxCNC takes them up."""
        try:
            for axis, offset in wanted.items():
                self._offsets[axis].check(offset)
        except ValueError as error:
            return {"failed": str(error)}
        now = time.monotonic()
        if now > until:
            return {"late": True}
        for axis, offset in wanted.items():
            moved = self._offsets[axis]
            moved.want(offset)
            moved.ramp, moved.lease_ends = None, now + self._settings["lease"]
        offsets = [self._offsets[axis] for axis in wanted]
        deadline = max(now + ANSWER_TIME, min(until, now + PAUSE))
        while not all(offset.settled for offset in offsets) and time.monotonic() < deadline:
            time.sleep(0.0003)
        get = self._hal.get_value
        why = ""
        if not all(offset.settled for offset in offsets):
            if not get("motion.motion-enabled"):
                why = "the machine is off"
            elif not get("motion.is-all-homed"):
                why = "the machine is not homed"
            else:
                why = "LinuxCNC does not take it up (in joint mode?)"
        return {
            "set": {
                axis: {
                    "request": self._offsets[axis].request,
                    "applied": self._offsets[axis].applied,
                }
                for axis in wanted
            },
            "limited": self._held_back(offsets),
            "why": why,
        }

    def _held_back(self, offsets: list[Offset]) -> bool:
        """Whether a soft limit holds an offset back: LinuxCNC says so, and it does not move."""
        if not self._hal.get_value("motion.eoffset-limited"):
            return False
        before = [offset.missing for offset in offsets]
        time.sleep(ANSWER_TIME)
        after = [offset.missing for offset in offsets]
        return any(
            now >= then > offset.step
            for offset, then, now in zip(offsets, before, after)  # noqa: B905 - any Python 3
        )

    def serve(self) -> None:
        """Answer until the input ends and the offsets are back at zero, or LinuxCNC is gone."""
        held = b""
        while True:
            moving = self._ending or any(offset.ramp for offset in self._offsets.values())
            ready = not self._ending and select.select([0], [], [], 0.002 if moving else NAP)[0]
            if self._ending:
                time.sleep(0.002)
            if ready:
                data = os.read(0, 65536)
                if not data:
                    self._ending = True
                *lines, held = (held + data).split(b"\n")
                for line in lines:
                    order = json.loads(line)
                    self._id = order.pop("id", None)
                    self.answer(order)
                    self._id = None
            self._watch()
            if self._release() and self._ending:
                return

    def answer(self, order: dict[str, Any]) -> None:
        """Carry out one order."""
        if "read" in order:
            self.say(**self.read(order["read"]))
        else:
            self.say(**self.set(order["set"], order["until"]))

    def _look(self) -> None:
        """Whether the servo thread has gone on: then pins are no older than the last look."""
        now, period = time.monotonic(), self._period()
        if period != self._beat[0]:
            self._beat = (period, now)
            # a cycle that is seen may still be under way; the one before it is over
            self._taken_in, self._fresh = self._fresh, self._looked
        self._looked = now

    def _watch(self) -> None:
        """Raise when the servo thread stands still."""
        self._look()
        now, since = self._looked, self._beat[1]
        if now - since > self._settings["servo_silence"]:
            raise GoneError("LinuxCNC's servo thread stands still")

    def _release(self) -> bool:
        """Take the offsets back when nobody answers for them; whether they are at zero."""
        now = time.monotonic()
        taken_back = [self._take_back(offset, now) for offset in self._offsets.values()]
        return all(taken_back)

    def _take_back(self, offset: Offset, now: float) -> bool:
        if offset.lease_ends is None or not (now > offset.lease_ends or self._ending):
            return True
        if offset.ramp is None:
            offset.ramp = (now, offset.wanted)
        began, start = offset.ramp
        share = max(0.0, 1.0 - (now - began) / self._settings["ramp"])
        offset.want(start * share)
        if share > 0.0:
            return False
        late = now - began > self._settings["ramp"] + 10 * ANSWER_TIME
        # where the machine is off, or not homed, LinuxCNC takes none up: it has no meaning there;
        # and at the end nobody waits for ever
        get = self._hal.get_value
        given_up = late and not (get("motion.motion-enabled") and get("motion.is-all-homed"))
        given_up |= self._ending and now - began > self._settings["ramp"] + AT_THE_END
        if (offset.settled and self._taken_in > offset.changed_at) or given_up:
            offset.lease_ends = offset.ramp = None
            return True
        return False


def run(kind: type[Bridge]) -> int:
    """Serve; the exit status: 0 Abbe ended it, 1 LinuxCNC is gone, 2 bad settings."""
    # LinuxCNC's libraries print to standard output; the answers get a pipe of their own.
    out = os.dup(1)
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    bridge = kind(json.loads(sys.argv[1]), out)

    def ended(_number: int, _frame: FrameType | None) -> None:
        raise GoneError("LinuxCNC ended")

    # LinuxCNC sends it to all parts of HAL when it ends.
    signal.signal(signal.SIGTERM, ended)
    try:
        bridge.attach()
        bridge.serve()
    except GoneError as gone:
        bridge.say(error=str(gone))
        return 1
    except (ValueError, ImportError, RuntimeError) as error:
        bridge.say(error=str(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(run(Bridge))
