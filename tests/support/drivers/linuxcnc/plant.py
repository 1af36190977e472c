#!/usr/bin/python3
"""The mechanics behind LinuxCNC's motors, as a component of its HAL: errors that nobody knows.

Run by the system's Python, started by LinuxCNC itself; imports nothing of Abbe. It follows the
motors' positions, after LinuxCNC's own compensation, and writes where the tool's tip really is into
a file, for instruments to see. All mm.
"""

import math
import mmap
import signal
import struct
import sys
import time
from pathlib import Path

RECORD = struct.Struct("<8d")
"""When (monotonic, s), the tip's X Y Z, the motors' X Y Z, when: torn where the two differ."""
PLAY = {"x": 0.018, "y": 0.009, "z": 0.014}
"""Lost motion: a carriage stands back by half of it, behind the motor."""
PERIOD = 0.002


def drawn(axis, motor):
    """Where a carriage without play stands when its motor is there."""
    error = {
        "x": 120e-6 * motor + 0.009 * math.sin(motor / 38.0),
        "y": -150e-6 * motor + 0.006 * math.cos(motor / 31.0),
        "z": 0.010 * math.tanh(motor / 35.0) - 1.2e-6 * motor**2,
    }[axis]
    return motor + error


def tip(x, y, z):
    """Where the tip is: what no table of single axes can hold is a tenth of the rest."""
    squareness, pitch = 6e-6, 5e-6
    straight = 0.0006 * math.sin(x / 25.0)
    return x + squareness * y, y + straight, z + pitch * x * y / 100.0


def main(path):
    import hal

    component = hal.component("plant")
    for axis in "xyz":
        component.newpin(axis, hal.HAL_FLOAT, hal.HAL_IN)
    component.ready()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    behind = dict.fromkeys("xyz", 0.0)
    before = {}
    with Path(path).open("r+b") as file, mmap.mmap(file.fileno(), RECORD.size) as seen:
        try:
            while True:
                now = time.monotonic()
                motors = {axis: component[axis] for axis in "xyz"}
                for axis, at in motors.items():
                    # a motor that turns round first goes through its play
                    half = PLAY[axis] / 2.0
                    behind[axis] += before.get(axis, at) - at
                    behind[axis] = min(max(behind[axis], -half), half)
                before = motors
                carriages = [drawn(axis, at) + behind[axis] for axis, at in motors.items()]
                seen[:] = RECORD.pack(now, *tip(*carriages), *motors.values(), now)
                time.sleep(PERIOD)
        finally:
            component.exit()


if __name__ == "__main__":
    main(sys.argv[1])
