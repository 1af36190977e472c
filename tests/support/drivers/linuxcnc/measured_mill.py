"""A real LinuxCNC with a plant behind its motors and a laser beside it, to be calibrated."""

from __future__ import annotations

import shutil
import sys
import time
from pathlib import Path

import numpy as np

from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.linuxcnc import plant, plant_laser
from tests.support.drivers.linuxcnc.mill import Mill

HAL = """
loadusr -Wn plant ./plant.py plant.now
net x-motor => plant.x
net y-motor => plant.y
net z-motor => plant.z
"""


class LaserProcess(SimulatedProcess):
    """The laser, in a process of its own."""

    def __init__(self, seen: Path, link: Path) -> None:
        super().__init__()
        self._command = [sys.executable, "-m", plant_laser.__name__, str(seen), str(link)]


class MeasuredMill(Mill):
    """LinuxCNC with errors that its configuration does not know, and files without effect.

    Attributes
    ----------
    laser
        The instrument.
    """

    laser: LaserProcess

    def start(self) -> None:
        """Before the first start: the plant, and files without effect (docs/linuxcnc.md)."""
        if not (self.folder / "plant.py").exists():
            shutil.copy(plant.__file__, self.folder)
            (self.folder / "plant.now").write_bytes(bytes(plant.RECORD.size))
            with (self.folder / "mill.hal").open("a") as hal:
                hal.write(HAL)
            none = self.folder / "comp" / "none"
            none.mkdir(parents=True)
            for axis in "xyz":
                (none / f"{axis}.comp").write_text("0 0 0\n")
            (none.parent / "current").symlink_to("none")
        super().start()

    def place_laser(self) -> LaserProcess:
        """Stand the laser beside it; a context."""
        self.laser = LaserProcess(self.folder / "plant.now", self.folder / "laser")
        return self.laser

    def forget_operator(self) -> None:
        """LinuxCNC was started anew by somebody else: whoever operates it has to attach again."""
        self._end_operator()

    def tip(self) -> np.ndarray:
        """Where the tip is, mm."""
        return np.array(self.laser.order("truth")["tip"])

    def walk(self, points: np.ndarray) -> np.ndarray:
        """Stand at points one after the other; actual − commanded there, mm, shape (n, 3)."""
        found = []
        for x, y, z in points:
            assert self.order("mdi", f"G21 G90 G53 G1 F12000 X{x:.4f} Y{y:.4f} Z{z:.4f}") == []
            before = self.tip()
            while True:  # its backlash compensation may still be under way
                time.sleep(0.03)
                now = self.tip()
                if np.abs(now - before).max() < 1e-7:
                    break
                before = now
            found.append(now - (x, y, z))
        return np.array(found)
