"""A planned set-up: where the machine goes, what is read there, how long it takes, its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.figures.places import reaches_by_joints
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine, nominal_direction
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.instruments import PlannedInstrument

F64 = NDArray[np.float64]
Index = NDArray[np.int64]
Place = tuple[float, float, float]

FEED = 50.0
"""Between targets, mm/s."""
TURN_RATE = np.radians(10.0)
"""Between targets, rad/s."""
MASTER_EVERY = 1200.0
"""s after which a set-up without a way back returns to its first target, the master point."""


@dataclass(frozen=True, eq=False)
class PlannedSetup:
    """One placing of an instrument and what is measured with it.

    Attributes
    ----------
    instrument
        The instrument.
    what
        For people: what is measured, where.
    axis
        The axis that moves; empty where several do.
    targets
        Axis → where it stands at each target, shape (k,), mm or rad; all axes of the machine.
    u
        Directions that are read at each target, shape (k, c, 3), machine axes; of distances zeros.
    kind
        What is read.
    free
        What the placing leaves unknown (`Setup.free`).
    sd
        Standard uncertainty of one reading at each target, shape (k,), mm or rad.
    tool, offset
        The tool's name and offset, mm.
    runs
        How often all targets are visited, each time both ways where `both_ways`.
    both_ways
        Whether each run comes back over the same targets.
    base
        Where the instrument of distances stands, mm, workpiece's frame.
    optics
        What stands where, for a picture: title → place, mm, as `path` counts.
    name
        Its number and name in a plan; empty for a candidate.
    """

    instrument: PlannedInstrument
    what: str
    axis: str
    targets: Mapping[str, F64]
    u: F64
    kind: Kind
    free: tuple[str, ...]
    sd: F64
    tool: str = ""
    offset: Place = (0.0, 0.0, 0.0)
    runs: int = 1
    both_ways: bool = True
    base: Place | None = None
    optics: dict[str, Place] = field(default_factory=dict)
    name: str = ""

    @property
    def count(self) -> int:
        """Number of targets."""
        return len(self.u)

    def path(self) -> F64:
        """The tool's tip at each target, (k, 3), mm: X, Y, Z (and those parallel) + tool."""
        return nominal_tip(self.targets, self.offset)

    def stood(self, machine: Machine) -> F64:
        """As `path`; where joints take the tip there (an arm), where they take it, (k, 3), mm."""
        return tip_at(machine, self.targets, self.offset)

    def visits(self) -> tuple[Index, Index]:
        """The targets in the order in which they are visited, and the sense, 1 or −1, each (v,).

        A set-up that does not come back returns to its first target in between and at its end.
        """
        there = np.arange(self.count)
        ones = np.ones(self.count, dtype=np.int64)
        if self.both_ways:
            once, sense = np.concatenate([there, there[::-1]]), np.concatenate([ones, -ones])
            return np.tile(once, self.runs), np.tile(sense, self.runs)
        every = max(2, int(MASTER_EVERY / (self.instrument.reading + 1.0)))
        all_ = np.tile(there, self.runs)
        order: list[int] = []
        for at in range(0, len(all_), every):
            order += [*all_[at : at + every].tolist(), 0]
        return np.array(order), np.ones(len(order), dtype=np.int64)

    def senses(self) -> dict[str, F64]:
        """Axis → direction in which it arrives, 1 or −1, shape (v,), in the order of `visits`.

        Before the first target, and where a run turns, the axes go beyond and come back.
        """
        order, sense = self.visits()
        found = {}
        for axis, at in self.targets.items():
            there = _arriving(at)
            back = _arriving(at[::-1])[::-1]
            found[axis] = np.where(sense > 0, there[order], back[order])
        return found

    @property
    def seconds(self) -> float:
        """How long it takes, s: setting up, ways between the targets, readings."""
        order, _ = self.visits()
        way = np.zeros(max(len(order) - 1, 0))
        for axis, at in self.targets.items():
            speed = TURN_RATE if is_rotary(axis) else FEED
            way = np.maximum(way, np.abs(np.diff(at[order])) / speed)
        return float(self.instrument.setup + len(order) * self.instrument.reading + way.sum())

    def rows(self, machine: Machine, start: float = 0.0) -> Campaign:
        """The rows that it will give, values 0, thermometers at the reference temperature.

        Parameters
        ----------
        start
            When it begins, s.
        """
        order, _ = self.visits()
        parts = self.u.shape[1]
        name = self.name or "new"
        visit = np.repeat(np.arange(len(order)), parts)
        at = order[visit]
        n = len(at)
        pace = (self.seconds - self.instrument.setup) / len(order)
        base = np.full(n, "" if self.base is None else _base(name))
        conditions = Conditions(
            positions={a: q[at] for a, q in self.targets.items()},
            directions={a: s[visit] for a, s in self.senses().items()},
            tool=np.tile(np.asarray(self.offset), (n, 1)),
            time=np.asarray(start + self.instrument.setup + pace * visit, dtype=np.float64),
            signals={
                s.name: np.full(n, resting(machine, s.name)) for s in machine.signals.values()
            },
            setup=np.full(n, name),
            u=self.u.reshape(-1, 3)[at * parts + np.tile(np.arange(parts), len(order))],
            base=base,
        )
        value = np.zeros(n)
        if self.base is not None:
            value = np.linalg.norm(self.stood(machine)[at] - np.asarray(self.base), axis=1)
        none = np.full(n, "", dtype="<U1")
        return Campaign(
            "planned",
            conditions,
            np.full(n, self.kind, dtype=np.int8),
            value,
            self.sd[at],
            none,
            none,
            np.arange(n),
            {name: Setup(name, self.free)},
            {} if self.base is None else {_base(name): self.base},
        )


def nominal_tip(targets: Mapping[str, F64], offset: Sequence[float]) -> F64:
    """The tool's tip at some targets, (k, 3), mm: X, Y, Z (and those parallel) + tool.

    Parameters
    ----------
    targets
        Axis → its positions, (k,), mm; rotary axes do not count.
    offset
        The tool's, mm.
    """
    count = max((len(q) for q in targets.values()), default=0)
    at = np.tile(np.asarray(offset, dtype=np.float64), (count, 1))
    for axis, position in targets.items():
        if not is_rotary(axis):
            at = at + np.outer(position, nominal_direction(axis))
    return at


def tip_at(machine: Machine, targets: Mapping[str, F64], offset: Sequence[float]) -> F64:
    """The tool's tip at some targets, (k, 3), mm, as X, Y, Z + tool count.

    Where joints take it there (an arm, a SCARA robot) by the kinematics of the machine as it is
    drawn.

    Parameters
    ----------
    targets
        Axis → its positions, (k,), mm or rad.
    offset
        The tool's, mm; of an arm where the tip is while all joints stand at 0.
    """
    if not reaches_by_joints(machine):
        return nominal_tip(targets, offset)
    count = max((len(q) for q in targets.values()), default=0)
    tool = np.tile(np.asarray(offset, dtype=np.float64), (count, 1))
    return np.asarray(Chain(machine, Conditions(dict(targets), tool=tool)).point)


def resting(machine: Machine, signal: str) -> float:
    """What a signal reads when nothing disturbs: temperatures the reference temperature, else 0."""
    return machine.reference_temperature if machine.signals[signal].temperature else 0.0


def _base(name: str) -> str:
    return f"B_{name}"


def _arriving(at: F64) -> F64:
    """Direction of arrival along a way, 1 or −1: that of the last move, at first of the next."""
    moves = np.sign(np.diff(at))
    moved = np.concatenate([moves[:1], moves]) if len(moves) else np.ones(len(at))
    for i in range(1, len(moved)):
        if moved[i] == 0.0:
            moved[i] = moved[i - 1]
    first = np.flatnonzero(moved)
    moved[: first[0] if len(first) else len(moved)] = moved[first[0]] if len(first) else 1.0
    return moved
