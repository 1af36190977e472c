"""Errors that somebody measured as a whole: a grid over the volume, or tables over the axes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import AfterValidator, Field, PrivateAttr

from abbe.compcore.effects.base import (
    F64,
    FUNCTIONAL_POINT,
    SPINDLE,
    Component,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.keys import Vector
from abbe.compcore.effects.registry import register
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, crossed
from abbe.compcore.machine.machine import Machine, nominal_direction
from abbe.compcore.multilinear import corners, weighted

_ABOUT = {"A": 0, "B": 1, "C": 2}
_ALONG = {"X": 0, "Y": 1, "Z": 2}


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTable:
    """One error as a function of one to three axes' positions, as it was measured.

    Attributes
    ----------
    error_motion
        At an axis: that axis's error motion. At `FUNCTIONAL_POINT`: the error itself, X Y Z along
        the machine's axes of that name, A B C the turn of the functional orientation.
    axes
        What it depends on.
    nodes
        Positions, strictly increasing, one array an axis, mm (rotary: rad).
    values
        Errors (actual − indicated) on the way up of ``axes[0]``, mm or rad.
    down
        On its way down; None: the same.
    lever
        (axis, origin): the values count per mm of that axis's position minus the origin.
    """

    error_motion: ErrorMotion
    axes: tuple[str, ...]
    nodes: tuple[F64, ...]
    values: F64
    down: F64 | None = None
    lever: tuple[str, float] | None = None

    @property
    def name(self) -> str:
        """ISO 230-1 name: E_XX for an axis's own table, E_X(X,Y,Z) for a grid's."""
        component, place = self.error_motion.component, self.error_motion.place
        if self.axes == (place,) and self.lever is None:
            return f"E_{component}{place}"
        inside = ",".join(self.positions)
        return f"E_{component}{'' if place == FUNCTIONAL_POINT else place}({inside})"

    @property
    def positions(self) -> tuple[str, ...]:
        """Axes on whose position the error depends."""
        beside = () if self.lever is None or self.lever[0] in self.axes else (self.lever[0],)
        return (*self.axes, *beside)


def _inside_the_folder(name: str) -> str:
    parts = name.replace("\\", "/").split("/")
    outside = name.startswith(("/", "~")) or ".." in parts or ":" in name or "" in parts
    if outside or any(ord(c) < 32 for c in name):
        raise ValueError("a file in the model's folder, or below it")
    return name


@register
class ErrorGrid(Effect):
    """Errors that were measured as a whole, at the points of a grid (ISO/TR 16907, 3.7 and 9.3).

    A grid says how large the error is, not why. It holds what no kinematic model can, and nothing
    that it was not measured at: no temperature, no other load, no other day. It is taken as it is;
    nothing of it is fitted. Effects beside it are fitted to what it leaves, such as the expansion
    of the scales since. ``abbe import-grid`` makes one of a grid or of tables in any dialect that
    Abbe reads (Etalon exchange, CSV grids and tables of ISO/TR 16907, a controller's own).

    Formula
        Straight lines between the grid's points (in two and three axes: bilinear, trilinear),
        beyond its ends the end's value. A grid's moves of X, Y, Z hold for the ``tool`` with which
        it was measured; with another one ``ω × (r − r₀)`` is added, ω the grid's turns, r and r₀
        the two offsets. Tables of single axes' error motions reach the tool by the levers, as the
        model's own effects do. Tables with two directions: the mean where it is not known.
    Parameters
    ----------
        None: all values are given.
    Signals
        None.
    Typical causes
        All that the machine had on the day of the measurement.
    Cure
        The grid itself, as a spatial error table (L-VOL+) or live. Where its errors can be
        separated, a model of causes says more and needs fewer points.
    Source
        ISO/TR 16907:2015, 3.7, 9.3.1 and 9.3.2.
    """

    kind = "error_grid"
    given: ClassVar[bool] = True
    file: Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_inside_the_folder)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    tool: Vector = (0.0, 0.0, 0.0)
    _tables: tuple[MeasuredTable, ...] | None = PrivateAttr(default=None)
    _text: str = PrivateAttr(default="")
    _stacks: tuple[_Stack, ...] = PrivateAttr(default=())

    def holding(self, tables: Sequence[MeasuredTable], sha256: str, text: str = "") -> ErrorGrid:
        """The same effect with its data, which a file of this checksum and text holds."""
        made = self.model_copy(update={"sha256": sha256})
        made._tables, made._text = tuple(tables), text
        made._stacks = _stacks(tables)
        return made

    def only(self, names: Collection[str]) -> ErrorGrid:
        """The same effect with some of its tables, by name.

        Raises
        ------
        InputError
            When its data have not been loaded.
        """
        if self._tables is None:
            raise self._not_loaded()
        kept = [table for table in self._tables if table.name in names]
        made = self.model_copy()
        made._tables, made._text, made._stacks = tuple(kept), self._text, _stacks(kept)
        return made

    def __eq__(self, other: object) -> bool:
        """Whether file, checksum and tool are the same; the checksum stands for the data."""
        if not isinstance(other, ErrorGrid):
            return NotImplemented
        mine, theirs = (self.file, self.sha256, self.tool), (other.file, other.sha256, other.tool)
        return mine == theirs

    def __hash__(self) -> int:
        return hash((self.file, self.sha256, self.tool))

    @property
    def spec(self) -> str:
        """Kind, file and tool; the checksum is for files."""
        tool = "" if not any(self.tool) else " tool=" + ",".join(f"{t:g}" for t in self.tool)
        return f"{self.kind} file={self.file}{tool}"

    @property
    def text(self) -> str:
        """The text of its file; empty where it does not come from one."""
        return self._text

    @property
    def tables(self) -> tuple[MeasuredTable, ...]:
        """Its data.

        Raises
        ------
        InputError
            When they have not been loaded.
        """
        if self._tables is None:
            raise self._not_loaded()
        return self._tables

    def _not_loaded(self) -> InputError:
        return InputError(
            "a grid comes with its file", field="file", found=self.file,
            expected="an effect that `abbe import-grid` has put into a model (its option --onto)",
        )  # fmt: skip

    def check(self, machine: Machine) -> None:
        """Every axis and every place of the grid is there."""
        super().check(machine)
        for table in self._tables or ():
            for axis in table.positions:
                machine.axis(axis, "file")
            if table.error_motion.place != FUNCTIONAL_POINT:
                machine.axis(table.error_motion.place, "file")

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """None."""
        return ()

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Axis → where all tables that depend on it have points, mm or rad."""
        found: dict[str, tuple[float, float]] = {}
        for table in self.tables:
            for axis, nodes in zip(table.axes, table.nodes, strict=True):
                low, high = found.get(axis, (-np.inf, np.inf))
                found[axis] = (max(low, float(nodes[0])), min(high, float(nodes[-1])))
        return found

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """What the tables say at each row; the grid's own moves and turns as seen by the tool.

        A grid whose tables were not loaded raises `InputError`.
        """
        if self._tables is None:
            raise self._not_loaded()
        sums: dict[ErrorMotion, F64] = {}
        for stack in self._stacks:
            for key, value in zip(stack.error_motions, stack.values(conditions).T, strict=True):
                sums[key] = sums[key] + value if key in sums else value
        n = conditions.n
        moves, turns = np.zeros((n, 3)), np.zeros((n, 3))
        found: list[tuple[ErrorMotion, F64]] = []
        for motion, value in sums.items():
            if motion.place != FUNCTIONAL_POINT:
                found.append((motion, value))
            elif motion.rotation:
                turns[:, _ABOUT[motion.component]] = value
            else:
                moves[:, _ALONG[motion.component]] = value
        direct = [m for m in sums if m.place == FUNCTIONAL_POINT]
        if direct:
            turning = any(m.rotation for m in direct)
            moves, turns = self._at_spindle(machine, conditions, moves, turns, turning)
            found += [(ErrorMotion(FUNCTIONAL_POINT, c), moves[:, k]) for c, k in _LINEAR]
            if turning:
                found += [(ErrorMotion(SPINDLE, c), turns[:, k]) for c, k in _TURNS]
        nothing = np.zeros((n, 0))
        return tuple(Motion(motion, nothing, 0, value) for motion, value in found)

    def _at_spindle(
        self, machine: Machine, conditions: Conditions, moves: F64, turns: F64, turning: bool
    ) -> tuple[F64, F64]:
        """Moves in machine axes, less what the turns do over the tool; turns in spindle axes."""
        if not _turned(machine):
            if turning and any(self.tool):
                moves = moves - crossed(turns, np.tile(self.tool, (len(turns), 1)))
            return moves, turns
        zero = np.zeros(len(moves))
        chain = Chain(
            machine,
            Conditions(
                {
                    a: conditions.position(a) if machine.axis(a).rotary else zero
                    for a in machine.structure.axes
                },
                tool=np.tile(self.tool, (len(moves), 1)),
            ),
        )
        along = np.einsum("nij,nj->ni", chain.axis_moves(), moves)
        if not turning:
            return along, turns
        along = along - crossed(turns, chain.lever(SPINDLE))
        axes = [
            chain.in_machine_axes(SPINDLE, np.broadcast_to(unit, turns.shape)) for unit in np.eye(3)
        ]
        return along, np.stack([np.einsum("ni,ni->n", axis, turns) for axis in axes], axis=1)

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The grid's axes; rotary ones too where they turn what it says."""
        used = {axis for table in self.tables for axis in table.positions}
        if any(t.error_motion.place == FUNCTIONAL_POINT for t in self.tables):
            used.update(machine.structure.rotary)
        return tuple(a for a in machine.structure.axes if a in used)

    def directions_used(self) -> tuple[str, ...]:
        """Axes whose tables have two directions."""
        return tuple(dict.fromkeys(t.axes[0] for t in self.tables if t.down is not None))

    def kinks(self, machine: Machine) -> dict[str, tuple[float, ...]]:
        """The grid's points."""
        found: dict[str, set[float]] = {}
        for table in self.tables:
            for axis, nodes in zip(table.axes, table.nodes, strict=True):
                found.setdefault(axis, set()).update(nodes.tolist())
        return {axis: tuple(sorted(nodes)) for axis, nodes in found.items()}

    def kinks_move(self, machine: Machine) -> bool:
        """Whether anything but tables over single axes is in it: no short sum of products then."""
        direct = any(t.error_motion.place == FUNCTIONAL_POINT for t in self.tables)
        return any(len(t.positions) > 1 for t in self.tables) or (direct and _turned(machine))


_LINEAR: tuple[tuple[Component, int], ...] = (("X", 0), ("Y", 1), ("Z", 2))
_TURNS: tuple[tuple[Component, int], ...] = (("A", 0), ("B", 1), ("C", 2))


class _Stack:
    """Tables of the same points, looked up together."""

    def __init__(self, tables: Sequence[MeasuredTable]) -> None:
        first = tables[0]
        self.axes, self.nodes, self.lever = first.axes, first.nodes, first.lever
        self.error_motions = [table.error_motion for table in tables]
        self.up = np.stack([table.values for table in tables], axis=-1)
        self.down: F64 | None = None
        if any(table.down is not None for table in tables):
            down = [table.values if table.down is None else table.down for table in tables]
            self.down = np.stack(down, axis=-1)

    def values(self, conditions: Conditions) -> F64:
        """The errors on n rows, shape (n, tables), mm or rad."""
        cells = corners(self.nodes, [conditions.position(axis) for axis in self.axes])
        value = weighted(cells, self.up)
        if self.down is not None:
            upward = 0.5 * (1.0 + np.sign(conditions.direction(self.axes[0])))[:, None]
            value = upward * value + (1.0 - upward) * weighted(cells, self.down)
        if self.lever is not None:
            axis, origin = self.lever
            value = value * (conditions.position(axis) - origin)[:, None]
        return value


def _stacks(tables: Sequence[MeasuredTable]) -> tuple[_Stack, ...]:
    alike: dict[tuple[object, ...], list[MeasuredTable]] = {}
    for table in tables:
        key = (table.axes, tuple(n.tobytes() for n in table.nodes), table.lever)
        alike.setdefault(key, []).append(table)
    return tuple(map(_Stack, alike.values()))


def _turned(machine: Machine) -> bool:
    """Whether linear axes or the tool may stand otherwise than along X, Y and Z."""
    axes = [machine.axis(a) for a in machine.structure.axes]
    return any(a.rotary or a.direction != nominal_direction(a.name) for a in axes)
