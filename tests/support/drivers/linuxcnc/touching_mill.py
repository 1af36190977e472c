"""A real LinuxCNC with a touch probe: its real-time part knows where tip and artefact really are.

The truth is a net of LinuxCNC's own real-time components behind the motors: wrong screws
(`lincurve`), axes out of square (`sum2`), the distance from a sphere (`hypot`) or the inside of a
block (`wcomp`). It shares no formula with Abbe, and no busy computer makes it late.
"""

from __future__ import annotations

import math
import shutil
import subprocess
from typing import ClassVar, Self

import numpy as np

from tests.support.drivers.linuxcnc import artefact, five_axis_artefact
from tests.support.drivers.linuxcnc.machine import Machine

TOOL = (0.0, 0.0, -100.0)
"""Of the tip from the axes, mm."""
TIP = 4.0
"""Diameter of the stylus's ball, mm."""
SCREWS = {
    "x": (-0.031, -0.012, 0.004, 0.017, 0.046),
    "y": (0.022, 0.009, -0.003, -0.021, -0.028),
    "z": (-0.018, -0.007, 0.011, 0.014, 0.009),
}
"""Errors of the screws at `PLACES`, straight in between, mm."""
PLACES = (-300.0, -140.0, 10.0, 150.0, 300.0)
LEAN, RISE = 70e-6, -55e-6
"""X comes along with Y, Z with X: mm per mm."""

_TRUTH = """
loadrt lincurve names=screw-x,screw-y,screw-z personality=5,5,5
loadrt sum2 names=lean-x,rise-z,from-x,from-y,from-z,along,aside
loadrt and2 names=works,flat,inside
loadrt hypot names=away
loadrt comp names=near
loadrt wcomp names=in-length,in-width,in-height
addf screw-x servo-thread
addf screw-y servo-thread
addf screw-z servo-thread
addf lean-x servo-thread
addf rise-z servo-thread
addf from-x servo-thread
addf from-y servo-thread
addf from-z servo-thread
net x-motor => screw-x.in
net y-motor => screw-y.in lean-x.in1
net z-motor => screw-z.in
net x-drawn screw-x.out => lean-x.in0 rise-z.in1
net z-drawn screw-z.out => rise-z.in0
net x-tip lean-x.out => from-x.in0
net y-tip screw-y.out => from-y.in0
net z-tip rise-z.out => from-z.in0
net touching => works.in0
net probe works.out => motion.probe-input
setp works.in1 1
setp from-x.gain1 -1
setp from-y.gain1 -1
setp from-z.gain1 -1
"""
_SPHERE = """
addf away servo-thread
addf near servo-thread
addf works servo-thread
net x-sphere artefact.x => from-x.in1
net y-sphere artefact.y => from-y.in1
net z-sphere artefact.z => from-z.in1
net x-away from-x.out => away.in0
net y-away from-y.out => away.in1
net z-away from-z.out => away.in2
net distance away.out => near.in0
net touching near.out
"""
_BLOCK = """
addf along servo-thread
addf aside servo-thread
addf in-length servo-thread
addf in-width servo-thread
addf in-height servo-thread
addf flat servo-thread
addf inside servo-thread
addf works servo-thread
net x-away from-x.out => along.in0 aside.in0
net y-away from-y.out => along.in1 aside.in1
net length along.out => in-length.in
net width aside.out => in-width.in
net height from-z.out => in-height.in
net long in-length.out => flat.in0
net wide in-width.out => flat.in1
net both flat.out => inside.in0
net high in-height.out => inside.in1
net touching inside.out
"""
_JOINT = """[AXIS_{letter}]
MIN_LIMIT = -220
MAX_LIMIT = 220
MAX_VELOCITY = 200
MAX_ACCELERATION = 2000

[JOINT_{number}]
TYPE = ANGULAR
HOME = 0
MIN_LIMIT = -220
MAX_LIMIT = 220
MAX_VELOCITY = 200
MAX_ACCELERATION = 2000
FERROR = 5
MIN_FERROR = 1
HOME_SEQUENCE = 0

"""


def tip(axes: np.ndarray) -> np.ndarray:
    """Where the tip really is when the motors are there, (n, 3), mm."""
    drawn = [a + np.interp(a, PLACES, SCREWS[k]) for k, a in zip("xyz", axes.T, strict=True)]
    x = drawn[0] + LEAN * axes[:, 1]
    z = drawn[2] + RISE * drawn[0]
    return np.stack([x, drawn[1], z], axis=1) + TOOL


def says(places: np.ndarray) -> np.ndarray:
    """Where LinuxCNC has the tip when it really is at places, (n, 3), mm."""
    axes = places - TOOL
    for _ in range(6):
        axes = axes - (tip(axes) - places)
    return axes + TOOL


class TouchingMill(Machine):
    """LinuxCNC whose probe touches a sphere on its rotary table, or a block.

    Attributes
    ----------
    diameter
        Of the sphere; None: there is a block.
    turning
        Rotary axes beside a sphere.
    what
        What they do: ``artefact``, a table that turns about C; else as `five_axis_artefact` has it.
    """

    HAL: ClassVar[str] = _TRUTH

    def __init__(
        self, diameter: float | None = None, turning: str = "C", what: str = "artefact"
    ) -> None:
        self.diameter = diameter
        self._turning = turning
        self._what = what
        joints = (_JOINT.format(letter=a, number=3 + i) for i, a in enumerate(turning))
        turned = {
            "COORDINATES = X Y Z": "COORDINATES = X Y Z " + " ".join(turning),
            "KINEMATICS = trivkins": f"KINEMATICS = trivkins coordinates=XYZ{turning}",
            "JOINTS = 3": f"JOINTS = {3 + len(turning)}",
            "[JOINT_0]": "".join(joints) + "[JOINT_0]",
        }
        super().__init__({} if diameter is None else turned)

    def start(self) -> None:
        """With the truth behind its motors."""
        if not (self.folder / "artefact.py").exists():
            plain = self._what == "artefact"
            own = artefact.__file__ if plain else five_axis_artefact.__file__
            shutil.copy(own, self.folder / "artefact.py")
            lines = self.HAL
            for axis, errors in SCREWS.items():
                for i, (at, error) in enumerate(zip(PLACES, errors, strict=True)):
                    lines += f"setp screw-{axis}.x-val-{i:02d} {at}\n"
                    lines += f"setp screw-{axis}.y-val-{i:02d} {at + error}\n"
            lines += f"setp lean-x.gain1 {LEAN}\nsetp rise-z.gain1 {RISE}\n"
            for axis, own in zip("xyz", TOOL, strict=True):
                lines += f"setp from-{axis}.offset {own}\n"
            if self.diameter is not None:
                lines += f"loadusr -Wn artefact ./artefact.py {'' if plain else self._what}\n"
                for i, a in enumerate(self._turning.lower(), start=3):
                    lines += f"net {a}-motor joint.{i}.motor-pos-cmd => joint.{i}.motor-pos-fb\n"
                    lines += f"net {a}-motor => artefact.{a}\n"
                lines += _SPHERE
                lines += f"setp near.in1 {0.5 * (self.diameter + TIP)}\n"
            else:
                lines += _BLOCK
            with (self.folder / "mill.hal").open("a") as hal:
                hal.write(lines)
        super().start()

    def __enter__(self) -> Self:
        """Switched on, homed, its stylus's length known (G43.1)."""
        super().__enter__()
        assert self.order("on") == []
        assert self.order("home") == []
        self.take_stylus()
        return self

    def take_stylus(self) -> None:
        """Tell LinuxCNC the stylus's length."""
        assert self.order("mdi", f"G21 G43.1 Z{-TOOL[2]}") == []

    def hal(self, *words: object) -> None:
        """``halcmd setp``, while it runs."""
        self.halcmd("setp", *words)

    def halcmd(self, *words: object) -> str:
        """``halcmd`` as typed; what it says."""
        command = ["halcmd", *map(str, words)]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    def stand(self, middle: np.ndarray) -> None:
        """Stand the sphere of a five-axis machine elsewhere, mm, rotary axes at 0."""
        for axis, value in zip("xyz", middle, strict=True):
            self.hal(f"artefact.start-{axis}", float(value))

    def lay(self, middle: np.ndarray, angle: float, size: tuple[float, float, float]) -> None:
        """Lay a block: its middle, mm, turned about Z by an angle, rad; length, width, height."""
        for axis, value in zip("xyz", middle, strict=True):
            self.hal(f"from-{axis}.in1", float(value))
        c, s = math.cos(angle), math.sin(angle)
        for name, x, y in (("along", c, s), ("aside", -s, c)):
            self.hal(f"{name}.gain0", x)
            self.hal(f"{name}.gain1", y)
        for name, own in zip(("length", "width", "height"), size, strict=True):
            self.hal(f"in-{name}.min", -0.5 * (own + TIP))
            self.hal(f"in-{name}.max", 0.5 * (own + TIP))
