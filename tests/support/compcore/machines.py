"""Machines and models that several tests use."""

from __future__ import annotations

import numpy as np

from abbe.compcore.effects import ErrorMotion
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure

LETTERS = "XYZABC"


def machine(code: str = "w b Y X Z t", **axes: Axis) -> Machine:
    """A machine with travels 0…700, 0…900, −360…0 mm (others 0…500) unless given."""
    structure = Structure.parse(code)
    travels = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}
    defaults = {a: Axis(a, travels.get(a, (0.0, 500.0))) for a in structure.axes}
    return Machine("test", structure, defaults | axes)


def motions(errors: dict[str, np.ndarray]) -> dict[ErrorMotion, np.ndarray]:
    """Axis → (n, 6) error motions X Y Z A B C, mm and rad, as the kinematic core takes them."""
    return {
        ErrorMotion(axis, letter): table[:, k]
        for axis, table in errors.items()
        for k, letter in enumerate(LETTERS)
    }
