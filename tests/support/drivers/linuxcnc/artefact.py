#!/usr/bin/python3
"""A sphere on a rotary table, as a component of LinuxCNC's HAL: where its middle really is.

Run by the system's Python, started by LinuxCNC itself; imports nothing of Abbe. The table turns
about a line that lies beside the one that everybody believes in and leans, and its angle is wrong.
Lengths mm.
"""

import math
import signal
import sys
import time

LINE = (20.0, -10.0, -250.0)
"""A point of the line about which the table is believed to turn, along Z."""
BESIDE = (0.052, -0.031)
"""By how much the line really lies beside it, X and Y."""
LEAN = (110e-6, -80e-6)
"""By how much it leans about X and Y, rad."""
WRONG = 60e-6
"""Amplitude of the table's error of angle, rad."""
START = (100.6, -10.9, -189.3)
"""Where the sphere's middle stands with the table at 0."""
PERIOD = 0.002


def centre(degrees):
    """Where the sphere's middle is when the motor has turned by an angle: the table turns back."""
    angle = -math.radians(degrees)
    angle += WRONG * math.sin(angle)
    ux, uy = LEAN[1], -LEAN[0]
    uz = math.sqrt(1.0 - ux * ux - uy * uy)
    foot = (LINE[0] + BESIDE[0], LINE[1] + BESIDE[1], LINE[2])
    x, y, z = (s - f for s, f in zip(START, foot))  # noqa: B905 - any Python 3
    along = ux * x + uy * y + uz * z
    cross = (uy * z - uz * y, uz * x - ux * z, ux * y - uy * x)
    c, s = math.cos(angle), math.sin(angle)
    turned = (
        c * own + s * other + (1.0 - c) * along * u
        for own, other, u in zip(  # noqa: B905
            (x, y, z), cross, (ux, uy, uz)
        )
    )
    return tuple(f + t for f, t in zip(foot, turned))  # noqa: B905


def main():
    import hal

    component = hal.component("artefact")
    component.newpin("c", hal.HAL_FLOAT, hal.HAL_IN)
    for axis in "xyz":
        component.newpin(axis, hal.HAL_FLOAT, hal.HAL_OUT)
    component.ready()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        while True:
            for axis, at in zip("xyz", centre(component["c"])):  # noqa: B905
                component[axis] = at
            time.sleep(PERIOD)
    finally:
        component.exit()


if __name__ == "__main__":
    main()
