"""An independent rigid-body machine: products of 4×4 transformations, nothing from compcore.

The truth that the kinematic core is tested against. Units mm and rad.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

DIRECTION = {
    "X": (1.0, 0.0, 0.0),
    "Y": (0.0, 1.0, 0.0),
    "Z": (0.0, 0.0, 1.0),
    "U": (1.0, 0.0, 0.0),
    "V": (0.0, 1.0, 0.0),
    "W": (0.0, 0.0, 1.0),
    "A": (1.0, 0.0, 0.0),
    "B": (0.0, 1.0, 0.0),
    "C": (0.0, 0.0, 1.0),
}


def translation(vector) -> np.ndarray:
    t = np.eye(4)
    t[:3, 3] = vector
    return t


def turn(letter: str, angle: float) -> np.ndarray:
    """Right-handed rotation about X (A), Y (B) or Z (C)."""
    c, s = np.cos(angle), np.sin(angle)
    t = np.eye(4)
    i, j = {"A": (1, 2), "B": (2, 0), "C": (0, 1)}[letter]
    t[i, i] = t[j, j] = c
    t[i, j], t[j, i] = -s, s
    return t


def error_transform(six: Sequence[float], pivot=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Translations and rotations (X Y Z A B C) about a pivot, as one small transformation."""
    rotation = turn("A", six[3]) @ turn("B", six[4]) @ turn("C", six[5])
    return translation(six[:3]) @ translation(pivot) @ rotation @ translation(-np.array(pivot))


def nominal_move(axis: str, position: float, location=(0.0, 0.0, 0.0)) -> np.ndarray:
    if axis[0] in "ABC":
        return translation(location) @ turn(axis[0], position) @ translation(-np.array(location))
    return translation(np.array(DIRECTION[axis[0]]) * position)


def tool_frame(
    workpiece_side: Sequence[str],
    tool_side: Sequence[str],
    position: Mapping[str, float],
    tool,
    errors: Mapping[str, Sequence[float]],
    pivots: Mapping[str, Sequence[float]] | None = None,
    locations: Mapping[str, Sequence[float]] | None = None,
) -> np.ndarray:
    """Workpiece → functional point, 4×4, for one pose.

    A workpiece-side axis errs before its own move, a tool-side axis after it. A rotary axis errs in
    a frame on its average line that does not turn with it.
    """
    pivots, locations = pivots or {}, locations or {}
    chain = np.eye(4)
    for axis in [*workpiece_side, *tool_side]:
        location = np.array(locations.get(axis, (0.0, 0.0, 0.0)))
        move = nominal_move(axis, position[axis], location)
        pivot = location if axis[0] in "ABC" else pivots.get(axis, (0.0, 0.0, 0.0))
        error = error_transform(errors.get(axis, np.zeros(6)), pivot)
        if axis[0] in "ABC":
            # seen from the stator: on the tool side that is the side before the move
            stator_first = axis in tool_side
            chain = chain @ error @ move if stator_first else chain @ move @ error
        else:
            chain = chain @ (error @ move if axis in workpiece_side else move @ error)
    return chain @ translation(tool)


def tool_error(*arguments, **keywords) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (3,) of the functional point and orientation (3, 3), actual against nominal.

    Both in the workpiece's frame.
    """
    workpiece_side, tool_side, position, tool, errors = arguments
    actual = tool_frame(workpiece_side, tool_side, position, tool, errors, **keywords)
    nominal = tool_frame(workpiece_side, tool_side, position, tool, {}, **keywords)
    return actual[:3, 3] - nominal[:3, 3], actual[:3, :3] @ nominal[:3, :3].T
