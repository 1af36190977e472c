#!/usr/bin/python3
"""A sphere on a five-axis machine, as a component of LinuxCNC's HAL: where the tip meets it.

Run by the system's Python, started by LinuxCNC itself; imports nothing of Abbe. Its first argument
says which machine: ``trunnion``, a table that tilts (A) and turns (C), both about lines that lie
beside those that are believed in; ``fork``, a head that turns (C) and tilts (A) a tool that is
longer than everybody believes, over a sphere that stands still. What comes out is where axes and
the tool's offset, unturned, put the tip when it is in the sphere's middle. Lengths mm.
"""

import math
import signal
import sys
import time

C_LINE = (20.0, -10.0, -250.0)
A_LINE = (20.0, -10.0, -230.0)
"""Points of the lines about which the table is believed to turn, along Z, and to tilt, along X."""
C_BESIDE = (0.052, -0.031, 0.0)
A_BESIDE = (0.0, 0.044, -0.037)
"""By how much the lines really lie beside them."""
TOOL = (0.0, 0.0, -100.0)
LONGER = 0.063
"""By how much the tool of the fork is really longer."""
PERIOD = 0.002


def _turned(at, line, along, angle):
    """A place turned about a line along X (0) or Z (2) through a point."""
    i, j = ((along + 1) % 3, (along + 2) % 3)
    c, s = math.cos(angle), math.sin(angle)
    found = list(at)
    u, v = at[i] - line[i], at[j] - line[j]
    found[i], found[j] = line[i] + c * u - s * v, line[j] + s * u + c * v
    return found


def _plus(one, other):
    return tuple(a + b for a, b in zip(one, other))  # noqa: B905 - any Python 3


def trunnion(start, a, c, beside=1.0):
    """Where a sphere stands that the table, which turns against its numbers, takes along."""
    c_line = _plus(C_LINE, [beside * v for v in C_BESIDE])
    a_line = _plus(A_LINE, [beside * v for v in A_BESIDE])
    on_table = _turned(start, c_line, 2, -math.radians(c))
    return tuple(_turned(on_table, a_line, 0, -math.radians(a)))


def fork(start, a, c, beside=1.0):
    """Where the unturned tip is when the turned one is in a sphere that stands still."""
    tool = (TOOL[0], TOOL[1], TOOL[2] - beside * LONGER)
    turned = _turned(_turned(tool, (0.0,) * 3, 0, math.radians(a)), (0.0,) * 3, 2, math.radians(c))
    return _plus(start, [t - r for t, r in zip(TOOL, turned)])  # noqa: B905


def main():
    import hal

    meets = {"trunnion": trunnion, "fork": fork}[sys.argv[1]]
    component = hal.component("artefact")
    for name in "ac":
        component.newpin(name, hal.HAL_FLOAT, hal.HAL_IN)
    for axis in "xyz":
        component.newpin("start-" + axis, hal.HAL_FLOAT, hal.HAL_IN)
        component.newpin(axis, hal.HAL_FLOAT, hal.HAL_OUT)
    component.ready()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        while True:
            start = [component["start-" + axis] for axis in "xyz"]
            found = meets(start, component["a"], component["c"])
            for axis, at in zip("xyz", found):  # noqa: B905
                component[axis] = at
            time.sleep(PERIOD)
    finally:
        component.exit()


if __name__ == "__main__":
    main()
