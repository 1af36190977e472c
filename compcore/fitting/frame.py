"""The reference frame of the errors (ISO/TR 16907, 7): primary axis, secondary axis, origin.

Where a workpiece sits is a convention, so a campaign in which every set-up has its own zero leaves
the frame open. ISO/TR 16907:2015 (7.3, 10.2) has it chosen by a primary axis, a secondary axis and
an origin; without such a choice the frame in which the errors are smallest is as good.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.fitting.design.unknowns import UnknownLayout
from abbe.compcore.fitting.undetermined.null_space import VOLUME, NullSpace, sample_volume
from abbe.compcore.fitting.undetermined.parameter_fields import ParameterFields
from abbe.compcore.linalg import svd
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_FELT = 1e-5
"""Conventions whose believable moves change the error by less than this, mm, are left alone."""


_COUNTS = 1e-6
"""Part of a free direction below which it does not say where an axis counts from."""

_BARE = "volume, without tool"
"""The places at which errors are to be least where no axis says what the frame is."""

_CARRIED = 1e-4
"""How little a parameter's square counts in the norm when its effect carries what others share."""


@dataclass(frozen=True, slots=True)
class ReferenceFrame:
    """A reference frame: by primary and secondary axis, or by least squares.

    Attributes
    ----------
    primary, secondary
        Linear axes. The middle of the volume has no error; along the primary axis through it the
        error across is the same at both ends, along the secondary axis that in the third
        direction. Empty: the frame of the least errors all over the volume, without tool.
    tool
        The tool's offset (mm) with which that holds; None: that of most of the campaign's rows.
    """

    primary: str = ""
    secondary: str = ""
    tool: tuple[float, float, float] | None = None

    @classmethod
    def parse(cls, text: str, tool: tuple[float, float, float] | None = None) -> ReferenceFrame:
        """The frame from ``least-squares`` or the primary and the secondary axis: ``X,Y``.

        Raises
        ------
        InputError
            For anything else.
        """
        if text == "least-squares":
            if tool is not None:
                raise InputError(
                    "the frame of the least errors has no tool",
                    field="frame-tool",
                    expected="--frame with a primary and a secondary axis",
                )
            return cls()
        axes = [part.strip() for part in text.split(",")]
        if len(axes) != 2 or not all(axes) or axes[0] == axes[1]:
            raise InputError(
                "not a reference frame",
                field="frame",
                found=text,
                expected="least-squares, or primary and secondary axis such as X,Y",
            )
        return cls(axes[0], axes[1], tool)

    def check(self, machine: Machine) -> None:
        """Check that the machine has the axes and that they span a frame.

        Raises
        ------
        InputError
            Naming the axis.
        """
        for name in (self.primary, self.secondary):
            if name and machine.axis(name, "frame").rotary:
                raise InputError(
                    "a frame is chosen by linear axes",
                    field="frame",
                    found=name,
                    expected="two of " + ", ".join(machine.structure.linear),
                )
        if self.primary and own_component(self.primary) == own_component(self.secondary):
            raise InputError("a frame needs two directions", field="frame", found=self.primary)


def most_used(tools: F64) -> tuple[float, float, float]:
    """The tool offset of most rows of `tools`, (n, 3), mm; of equally many the first."""
    if not len(tools):
        return (0.0, 0.0, 0.0)
    found, first, count = np.unique(tools, axis=0, return_index=True, return_counts=True)
    most = count == count.max()
    x, y, z = found[most][np.argmin(first[most])].tolist()
    return x, y, z


def alignment(fields: ParameterFields, theta: F64, null: NullSpace, frame: ReferenceFrame) -> F64:
    """The transformation of θ into the chosen frame, shape (m, m): ``θ → A·θ``, ``C → A·C·Aᵀ``.

    Changes neither χ² nor any error but for a rigid displacement (Baarda's S-transformation).
    """
    model, layout = fields.model, fields.layout
    if not null.convention.shape[1]:
        return np.eye(layout.size)
    m = layout.model_size
    free, agreed = _agreed(model, layout, null.convention)
    constraint = _constraint(fields, theta, frame)
    moves = constraint @ (layout.scale[:m, None] * free[:m])
    left, size, right = svd(moves, full=moves.shape[0] < moves.shape[1])
    felt = int((size > _FELT * np.sqrt(constraint.shape[0])).sum())
    # derivatives by non-linear parameters are no errors
    constraint[:, list(layout.searched)] = 0.0
    along = (right[:felt].T / size[:felt]) @ (left[:, :felt].T @ constraint)
    out = np.eye(layout.size)
    out[:, :m] -= layout.scale[:, None] * (free @ along)
    return np.asarray(_carried(model, layout, free @ right[felt:].T) @ out @ agreed)


def _agreed(model: Model, layout: UnknownLayout, free: F64) -> tuple[F64, F64]:
    """What is left of the free directions (m, k) once it is agreed where axes count from, and how.

    Where it counts from is agreed upon (`Parameter.convention`). An axis of a machine that has X, Y
    and Z stands at 0 where it shows 0: what nothing tells from its zero is something else. Of an
    arm's joints it is their zeros, which are anywhere, and no links that lie askew. Of two zeros
    that are the same it is that of the axis nearer to the bed.
    """
    move = np.eye(layout.size)
    counted = _counted(model, layout)
    own = {own_component(a) for a in model.machine.structure.linear}
    if len(own) < len("XYZ"):
        zeros = {i for rows in counted for i in rows}
        counted.insert(0, [i for i in range(layout.model_size) if i not in zeros])
    for rows in counted:
        kept = free[rows]
        _, size, right = np.linalg.svd(kept)
        rank = int((size > _COUNTS).sum())
        if not rank:
            continue
        back = np.linalg.pinv(kept, rcond=_COUNTS / float(size[0]))
        step = np.eye(layout.size)
        step[:, rows] -= layout.scale[:, None] * (free @ back) / layout.scale[rows]
        move = step @ move
        free = free @ right[rank:].T
    return free, move


def _counted(model: Model, layout: UnknownLayout) -> list[list[int]]:
    """The unknowns that say where an axis counts from, by axes, the nearest to the bed last."""
    found: dict[str, list[int]] = {}
    for effect, where in zip(model.effects, layout.terms, strict=True):
        axis = getattr(effect, "axis", None)
        if axis in model.machine.structure.axes:
            own = [
                where.start + i for i, p in enumerate(effect.linear(model.machine)) if p.convention
            ]
            found.setdefault(str(axis), []).extend(own)
    structure = model.machine.structure
    order = [*structure.workpiece_side, *reversed(structure.tool_side)]
    return [found[a] for a in order if found.get(a)]


def _carried(model: Model, layout: UnknownLayout, unseen: F64) -> F64:
    """What moves θ along unseen directions (m, k) into the effects that best carry them.

    Of a constant angle and a squareness that are one and the same, all is called squareness.
    """
    weight = np.ones(layout.size)
    weight[layout.model_size :] = 0.0  # base points and tools have no zero to be near to
    weight[list(layout.searched)] = 0.0
    for effect, where in zip(model.effects, layout.terms, strict=True):
        if effect.carries:
            weight[where] = _CARRIED
    weighted = weight[:, None] * unseen
    back = np.linalg.pinv(unseen.T @ weighted, rcond=_CARRIED**2, hermitian=True) @ weighted.T
    return np.asarray(
        np.eye(layout.size) - (layout.scale[:, None] * (unseen @ back)) / layout.scale
    )


def _at(
    machine: Machine, positions: dict[str, F64], tool: tuple[float, float, float] | None = None
) -> Conditions:
    """A machine at its reference temperature, coming from nowhere."""
    n = len(next(iter(positions.values())))
    signals = {
        s.name: np.full(n, machine.reference_temperature if s.temperature else 0.0)
        for s in machine.signals.values()
    }
    return Conditions(positions, tool=np.tile(tool or (0.0, 0.0, 0.0), (n, 1)), signals=signals)


def _constraint(fields: ParameterFields, theta: F64, frame: ReferenceFrame) -> F64:
    """What is to be least, or 0, in a frame, by each parameter, shape (k, m); a copy."""
    machine = fields.model.machine
    if frame.primary:
        fields.place(frame, lambda: _ends(machine, frame))
        translation, _ = fields.at(theta, frame)
        return np.asarray(_along_the_axes(frame) @ translation.reshape(15, -1))
    sampled = fields.place(VOLUME, lambda: sample_volume(machine, fields.campaign))
    fields.place(_BARE, lambda: _at(machine, dict(sampled.positions)))
    translation, _ = fields.at(theta, _BARE)
    return translation.reshape(3 * len(translation), -1).copy()


def _ends(machine: Machine, frame: ReferenceFrame) -> Conditions:
    """The middle, both ends of the primary and both ends of the secondary axis; five conditions."""
    middle = {a: machine.axes[a].middle for a in machine.structure.axes}
    stops = [middle]
    for name in (frame.primary, frame.secondary):
        stops += [{**middle, name: end} for end in machine.axes[name].travel]
    return _at(machine, {a: np.array([s[a] for s in stops]) for a in middle}, frame.tool)


def _along_the_axes(frame: ReferenceFrame) -> F64:
    """The middle's error and what an axis's ends differ by, of the errors at `_ends`, (6, 15)."""
    first = "XYZ".index(own_component(frame.primary))
    second = "XYZ".index(own_component(frame.secondary))
    third = 3 - first - second
    combine = np.zeros((6, 15))
    combine[:3, :3] = np.eye(3)
    for row, (low, high, direction) in enumerate(
        [(1, 2, second), (1, 2, third), (3, 4, third)], start=3
    ):
        combine[row, 3 * low + direction] = -1.0
        combine[row, 3 * high + direction] = 1.0
    return combine
