"""Set-ups that a service engineer can do, as the rows of a campaign that they would give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import Sentence, said

F64 = NDArray[np.float64]

_POINTS = 13
_WARMER = 3.0


@dataclass(frozen=True, eq=False)
class Proposal:
    """A set-up that could be measured.

    Attributes
    ----------
    what
        For people: what to measure, where, with which tool.
    rows
        The rows it would give (values unknown, 0).
    effort
        Rough effort, in units of a plain line.
    line
        What it has in common with the same line by other tools; empty where there is none.
    """

    what: str
    rows: Campaign
    effort: float = 1.0
    line: str = ""


def practicable(machine: Machine, campaign: Campaign) -> Iterator[Proposal]:
    """Set-ups that a service engineer can do: lines, straightness, angles, diagonals, warming."""
    axes = machine.structure.linear
    letters = {"X": 0, "Y": 1, "Z": 2}
    usual = said("the usual tool")
    tools: dict[Sentence, F64] = {usual: np.median(campaign.conditions.tool, axis=0)}
    tools[said("a tool 150 mm to the side")] = tools[usual] + np.array([150.0, 0.0, 0.0])
    tools[said("a tool 150 mm longer")] = tools[usual] + np.array([0.0, 0.0, -150.0])
    for axis in axes:
        others = [a for a in axes if a != axis]
        parts = ((0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9), (0.5, 0.5))
        # with fewer other axes some of these are the same line
        for at in dict.fromkeys(p[: len(others)] for p in parts):
            where = dict(zip(others, at, strict=False))
            beside = ", ".join(f"{a} = {_at(machine, a, p):.0f} mm" for a, p in where.items())
            place = said("the line {where}", where=beside) if beside else said("its travel")
            for name, tool in tools.items():
                ends = {axis: (0.02, 0.98)} | {a: (p, p) for a, p in where.items()}
                if axis in letters:
                    yield Proposal(
                        said(
                            "positioning of {axis} along {place}, with {tool}",
                            axis=axis,
                            place=place,
                            tool=name,
                        ),
                        _line(campaign, machine, ends, np.eye(3)[letters[axis]], tool),
                        line=f"{axis} {beside}",
                    )
            for across in others:
                if across in letters:
                    yield Proposal(
                        said(
                            "straightness of {axis} in {across} along {place}",
                            axis=axis,
                            across=across,
                            place=place,
                        ),
                        _line(
                            campaign,
                            machine,
                            {axis: (0.02, 0.98)} | {a: (p, p) for a, p in where.items()},
                            np.eye(3)[letters[across]],
                            tools[usual],
                            free=("zero", "slope"),
                        ),
                        effort=1.5,
                    )
        for about in "XYZ":
            ends = {axis: (0.02, 0.98)} | dict.fromkeys(others, (0.5, 0.5))
            yield Proposal(
                said(
                    "angle of {axis} about {about} (level or autocollimator) along its travel",
                    axis=axis,
                    about=about,
                ),
                _line(
                    campaign,
                    machine,
                    ends,
                    np.eye(3)["XYZ".index(about)],
                    tools[usual],
                    kind=Kind.ROTATION,
                ),
                effort=1.5,
            )
    yield from _diagonals(machine, campaign, axes, tools[usual])
    yield from _turned(machine, campaign, tools[usual])
    yield from _warmed(machine, campaign, axes, tools[usual])


def _diagonals(
    machine: Machine, campaign: Campaign, axes: Sequence[str], tool: F64
) -> Iterator[Proposal]:
    if not {"X", "Y", "Z"} <= set(axes):
        return
    for signs in product((1, -1), repeat=2):
        parts = {"X": (0.04, 0.96)}
        for a, s in zip(("Y", "Z"), signs, strict=True):
            parts[a] = (0.04, 0.96) if s > 0 else (0.96, 0.04)
        u = np.array([_at(machine, a, parts[a][1]) - _at(machine, a, parts[a][0]) for a in "XYZ"])
        u /= np.linalg.norm(u)
        yield Proposal(
            said(
                "body diagonal, X+ Y{y} Z{z}",
                y="+" if signs[0] > 0 else "−",
                z="+" if signs[1] > 0 else "−",
            ),
            _line(campaign, machine, parts, u, tool),
            effort=2.0,
        )


def _turned(machine: Machine, campaign: Campaign, tool: F64) -> Iterator[Proposal]:
    """Each rotary axis turned from end to end, and the error in each direction meanwhile."""
    for axis in machine.structure.axes:
        if not machine.axes[axis].rotary or axis not in campaign.conditions.positions:
            continue
        for u, letter in zip(np.eye(3), "XYZ", strict=True):
            yield Proposal(
                said(
                    "the error in {u} while {axis} turns through its travel, all others at rest",
                    u=letter,
                    axis=axis,
                ),
                _line(campaign, machine, {axis: (0.02, 0.98)}, u, tool),
                effort=2.0,
            )


def _warmed(
    machine: Machine, campaign: Campaign, axes: Sequence[str], tool: F64
) -> Iterator[Proposal]:
    """A positioning line and the middle of the volume, with the place of one sensor warmed."""
    letters = {"X": 0, "Y": 1, "Z": 2}
    for name in campaign.conditions.signals:
        signal = machine.signals.get(name)
        # the air cannot be warmed in one place only
        if signal is None or not signal.temperature or signal.role in ("ambient", "air"):
            continue
        for axis in axes:
            if axis not in letters:
                continue
            others = [a for a in axes if a != axis]
            for u_axis in "XYZ":
                ends = {axis: (0.02, 0.98)} | dict.fromkeys(others, (0.85, 0.85))
                u = np.eye(3)[letters[u_axis]]
                line = _line(campaign, machine, ends, u, tool)
                c = line.conditions
                course = np.where(np.arange(c.n) < c.n // 2, 0.0, _WARMER)
                signals = {**c.signals, name: c.signals[name] + course}
                what = said(
                    "the error in {u} along {axis}, there with {sensor} as it is and back "
                    "with its place {warmer} K warmer (heat only there, others steady)",
                    u=u_axis,
                    axis=axis,
                    sensor=name,
                    warmer=f"{_WARMER:.0f}",
                )
                yield Proposal(
                    what, replace(line, conditions=replace(c, signals=signals)), effort=4.0
                )


def _at(machine: Machine, axis: str, part: float) -> float:
    low, high = machine.axes[axis].travel
    return low + part * (high - low)


def _line(
    campaign: Campaign,
    machine: Machine,
    ends: Mapping[str, tuple[float, float]],
    u: F64,
    tool: F64,
    *,
    kind: Kind = Kind.DISPLACEMENT,
    free: tuple[str, ...] = ("zero",),
) -> Campaign:
    way = np.linspace(0.0, 1.0, _POINTS)
    way = np.concatenate([way, way[::-1]])
    going = np.repeat([1.0, -1.0], _POINTS)
    positions = {
        a: _at(machine, a, p0) + way * (_at(machine, a, p1) - _at(machine, a, p0))
        for a, (p0, p1) in ends.items()
    }
    directions = {
        a: going * np.sign(p1 - p0) if p1 != p0 else np.ones(2 * _POINTS)
        for a, (p0, p1) in ends.items()
    }
    return rows_at(campaign, machine, positions, u, directions, tool, kind, free)


def rows_at(
    like: Campaign,
    machine: Machine,
    positions: Mapping[str, F64],
    u: F64,
    directions: Mapping[str, F64] | None = None,
    tool: F64 | None = None,
    kind: Kind = Kind.DISPLACEMENT,
    free: tuple[str, ...] = ("zero",),
) -> Campaign:
    """Rows as one set-up would give them, under the campaign's mean conditions."""
    n = len(next(iter(positions.values())))
    middle = {a: np.full(n, machine.axes[a].middle) for a in machine.structure.axes}
    typical, time, signals = _mean_conditions(like, kind)
    conditions = Conditions(
        positions={**middle, **positions},
        directions=dict(directions or {}),
        tool=np.broadcast_to(np.zeros(3) if tool is None else tool, (n, 3)).copy(),
        time=np.asarray(time + 12.0 * np.arange(n), dtype=np.float64),
        signals={name: np.full(n, mean) for name, mean in signals.items()},
        setup=np.full(n, "new"),
        u=np.broadcast_to(u, (n, 3)).copy(),
    )
    empty = np.full(n, "", dtype="<U1")
    return Campaign(
        "proposed",
        conditions,
        np.full(n, kind, dtype=np.int8),
        np.zeros(n),
        np.full(n, typical),
        empty,
        empty,
        np.arange(n),
        {"new": Setup("new", free)},
    )


@lru_cache(maxsize=2)
def _mean_conditions(like: Campaign, kind: Kind) -> tuple[float, float, dict[str, float]]:
    """Of a campaign: the usual uncertainty of a kind of row, mm or rad, mean time, s, and signals.

    A hundred set-ups of one campaign ask for them.
    """
    same = like.kind == kind
    sd = like.sd[same] if same.any() else like.sd
    typical = (
        float(np.nanmedian(sd))
        if np.isfinite(sd).any()
        else (1e-6 if kind == Kind.ROTATION else 5e-4)
    )
    c = like.conditions
    signals = {name: float(np.mean(v)) for name, v in c.signals.items()}
    return typical, float(np.mean(c.time)), signals
