"""A campaign: measurements of a machine, with what the placing of the instrument left unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.coverage import Coverage, SetupCoverage
from abbe.compcore.campaign.even_steps import even_steps, places
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import nominal_direction
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.notebook import data_frame

if TYPE_CHECKING:
    import pandas as pd

F64 = NDArray[np.float64]


class Kind(IntEnum):
    """What a row measures (formats.md, column ``kind``)."""

    DISPLACEMENT = 0
    """Component of the functional point's error along u, mm inside the code (µm in the file)."""
    ROTATION = 1
    """Component of the functional orientation's error about u, rad (µrad in the file)."""
    DISTANCE = 2
    """Absolute distance from a base point to the functional point, mm."""
    BASE_DISTANCE = 3
    """Distance between two base points, mm."""


PART = "."
"""Between a set-up's name and the number of its zero: ``01_laser.2``. No plan has it in a name."""

LENGTHS = (Kind.DISPLACEMENT, Kind.DISTANCE, Kind.BASE_DISTANCE)
"""The kinds of rows that are lengths, mm; the others are angles."""


_ALONG = 0.98
"""Cosine from which a measured direction counts as one component."""


@dataclass(frozen=True, slots=True)
class Unsteady:
    """How a thermometer read, K: by what it scattered about what was taken, and its steps, or 0."""

    scatter: float
    step: float


@dataclass(frozen=True, slots=True)
class Setup:
    """One placing of the instrument: what it leaves unknown is fitted along and thrown away.

    `free` holds ``zero``, ``slope``, ``frame`` (docs/campaigns.md).
    """

    name: str
    free: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Tool:
    """A tool whose offset (mm) is known approximately; `free` names the components to fit."""

    name: str
    offset: tuple[float, float, float]
    free: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Campaign:
    """n measured rows.

    Attributes
    ----------
    name
        The file's name, or what several campaigns joined are called.
    conditions
        Where and when; with `setup`, `u`, `base` and `run` filled in. Set-up names are unique
        across joined campaigns.
    kind
        Shape (n,), values of `Kind`.
    value
        Shape (n,): error = actual − indicated, mm or rad; for distances the distance, mm.
    sd
        Shape (n,): standard uncertainty in the unit of `value`; NaN where not stated.
    base2
        Shape (n,): second base point of base distances, else empty.
    tool_name
        Shape (n,): named tool, else empty.
    line
        Shape (n,): line number in the file, for people.
    setups, bases, tools
        What the metadata say; every set-up that occurs is in `setups`; bases mm, workpiece frame.
    files
        Path → SHA-256 of what was read.
    metadata
        machine, instrument, notes and whatever else stands at the top, per file.
    spindle
        Name of the axis in brackets whose angle was recorded (`conditions.spindle_angle`).
    gauge, gauge_sd
        Shape (n,): name of the calibrated gauge that a row was measured against, empty where none,
        and the standard uncertainty of its calibration in the row's value, mm or rad: an error that
        all rows of one gauge have in common. None where no row has one.
    lacking
        Signal that only some of several joined files record → the files without it; such a signal
        is not in `conditions`.
    unseen
        Signal that was not seen in every row, such as the feed with which the machine came → file
        and line of the first row without it; such a signal is not in `conditions`.
    unsteady
        Thermometers whose readings in `conditions` are without their noise or steps
        (`steady_thermometers`), and how they read; None where they are as they were recorded.
    """

    name: str
    conditions: Conditions
    kind: NDArray[np.int8]
    value: F64
    sd: F64
    base2: NDArray[np.str_]
    tool_name: NDArray[np.str_]
    line: NDArray[np.int64]
    setups: Mapping[str, Setup] = field(default_factory=dict)
    bases: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    tools: Mapping[str, Tool] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    metadata: Sequence[Mapping[str, object]] = ()
    spindle: str | None = None
    lacking: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    unseen: Mapping[str, tuple[str, int]] = field(default_factory=dict)
    gauge: NDArray[np.str_] | None = None
    gauge_sd: F64 | None = None
    unsteady: Mapping[str, Unsteady] | None = None

    def __post_init__(self) -> None:
        if self.conditions.kind is not self.kind:
            lengths = self.kind >= Kind.DISTANCE
            distance = np.where(lengths, self.value, 0.0) if lengths.any() else None
            stated = replace(self.conditions, kind=self.kind, distance=distance)
            object.__setattr__(self, "conditions", stated)

    @property
    def n(self) -> int:
        """Number of rows."""
        return self.conditions.n

    @property
    def clocked(self) -> bool:
        """Whether the rows say when they were measured; their order is no clock."""
        run, time = self.conditions.run, self.conditions.time
        runs = np.zeros(self.n, dtype=np.int64) if run is None else run
        return any(np.ptp(time[runs == r]) > 0.0 for r in np.unique(runs))

    def measured_components(self) -> NDArray[np.str_]:
        """What each row measured along, shape (n,): X, Y, Z, or ``oblique``."""
        u = self.conditions.u
        if u is None:
            return np.full(self.n, "oblique")
        size = np.abs(u)
        along = np.array(["X", "Y", "Z"])[size.argmax(axis=1)]
        return np.where(size.max(axis=1) > _ALONG, along, "oblique")

    def functional_moves(self) -> F64:
        """Where the linear axes stand, as a vector, shape (n, 3), mm."""
        at = np.zeros((self.n, 3))
        for axis, position in self.conditions.positions.items():
            if not is_rotary(axis):
                at += np.outer(position, nominal_direction(axis))
        return at

    def file_of(self, row: int) -> str:
        """The file that a row of joined campaigns stands in; the name where none was read."""
        run = self.conditions.run
        files = list(self.files)
        first = 0 if run is None else int(run.min())
        return files[0 if run is None else int(run[row]) - first] if files else self.name

    def rows(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> Campaign:
        """Some of the rows, with the set-ups that still occur in them."""
        conditions = self.conditions.rows(index)
        names = set() if conditions.setup is None else set(np.unique(conditions.setup).tolist())
        return replace(
            self,
            conditions=conditions,
            kind=self.kind[index],
            value=self.value[index],
            sd=self.sd[index],
            base2=self.base2[index],
            tool_name=self.tool_name[index],
            line=self.line[index],
            setups={name: s for name, s in self.setups.items() if name in names},
            gauge=None if self.gauge is None else self.gauge[index],
            gauge_sd=None if self.gauge_sd is None else self.gauge_sd[index],
        )

    def to_pandas(self) -> pd.DataFrame:
        """The rows as a data frame.

        One column for each axis (mm, rotary: rad), ``s_X`` … its direction of approach where it was
        recorded, ``time`` (s), one for each signal in its own unit, ``tool_x`` … (mm), ``setup``,
        ``kind``, ``u_x`` … (the measured direction), ``value`` and ``sd`` (mm or rad), ``line``.

        Raises
        ------
        AbbeError
            When pandas is not installed.
        """
        c = self.conditions
        columns: dict[str, Any] = {**c.positions}
        columns |= {f"s_{axis}": values for axis, values in c.directions.items()}
        columns |= {"time": c.time, **c.signals}
        columns |= {f"tool_{k}": c.tool[:, i] for i, k in enumerate("xyz")}
        if c.setup is not None:
            columns["setup"] = c.setup.astype(object)
        columns["kind"] = [Kind(k).name.lower() for k in self.kind]
        if c.u is not None:
            columns |= {f"u_{k}": c.u[:, i] for i, k in enumerate("xyz")}
        return data_frame({**columns, "value": self.value, "sd": self.sd, "line": self.line})

    def coverage(self) -> Coverage:
        """What the campaign recorded and varied; distances between base points left out."""
        return self._coverage

    @cached_property
    def _coverage(self) -> Coverage:
        placed = self.kind != Kind.BASE_DISTANCE
        c = self.conditions if placed.all() else self.conditions.rows(placed)
        moving = frozenset(a for a, q in c.positions.items() if q.size and np.ptp(q) > 0.0)
        reversing = frozenset(a for a, s in c.directions.items() if (s > 0).any() and (s < 0).any())
        signals = {
            name: (float(v.min()), float(v.max()))
            for name, v in c.signals.items()
            if v.size and np.ptp(v) > 0.0
        }
        runs = np.zeros(c.n, dtype=np.int64) if c.run is None else c.run
        duration = max((float(np.ptp(c.time[runs == run])) for run in np.unique(runs)), default=0.0)
        parts = [c.time[c.stretches == one] for one in np.unique(c.stretches)]
        return Coverage(
            moving,
            reversing,
            signals,
            tuple(self.setups),
            tuple(self.bases),
            duration,
            bool((self.kind == Kind.ROTATION).any()),
            bool(np.ptp(c.tool, axis=0).any()) if c.n else False,
            self._setup_surveys(),
            len(np.unique(runs)),
            _interval(parts),
            even_steps(c),
            places(c),
            {a: (float(q.min()), float(q.max())) for a, q in c.positions.items() if a in moving},
            max((float(np.ptp(t)) for t in parts), default=0.0),
        )

    def _setup_surveys(self) -> dict[str, SetupCoverage]:
        c = self.conditions
        if c.setup is None:
            return {}
        setups = c.setup_rows()
        order = np.argsort(setups.number, kind="stable")
        ends = np.cumsum(np.bincount(setups.number, minlength=len(setups.index)))
        at = self.functional_moves()
        found = {}
        toward: tuple[float, ...]
        for name, free in ((s.name, s.free) for s in self.setups.values()):
            i = setups.index.get(name)
            if i is None:
                continue
            rows = order[(ends[i - 1] if i else 0) : ends[i]]
            kinds = frozenset(Kind(k).name.lower() for k in np.unique(self.kind[rows]))
            along = across = 0.0
            spread, toward, all_round = 0, (), False
            if c.u is not None:
                spread = int(
                    np.linalg.matrix_rank(c.u[rows].T @ c.u[rows], tol=1e-6, hermitian=True)
                )
                if spread == 1:
                    toward = tuple(np.round(c.u[rows[0]], 1).tolist())
                step = at[rows] - at[rows[0]]
                all_round = kinds == {"displacement"} and _touched_all_round(c.u[rows], step)
                part = np.einsum("ni,ni->n", step, c.u[rows])
                along = float(np.ptp(part))
                across = float(np.linalg.norm(step - part[:, None] * c.u[rows], axis=1).max())
            duration = float(np.ptp(c.time[rows]))
            found[name] = SetupCoverage(
                kinds, len(rows), duration, along, across, free, spread, toward, all_round
            )
        return found


_SPHERE = 100.0
"""mm: extent of what a probe touches from all round, at the most: a sphere and its tip."""

_OBLIQUE = 0.98
"""Greatest component of a direction that is none of the machine's axes."""

_TOUCHES = 6
"""Oblique directions from which on a sphere was touched all round."""


def _touched_all_round(u: F64, at: F64) -> bool:
    """Whether rows look in many directions at something small; u and places (m, 3)."""
    if float(np.ptp(at, axis=0).max()) > _SPHERE:
        return False
    oblique = np.unique(np.round(u[np.abs(u).max(axis=1) < _OBLIQUE], 1), axis=0)
    return len(oblique) >= _TOUCHES and np.linalg.matrix_rank(oblique, tol=0.3) == 3


def _interval(clocks: Sequence[F64]) -> float:
    """Time between readings (`Coverage.interval`), s, of runs' times; 0 without any."""
    gaps = np.sort(np.concatenate([np.diff(np.unique(t)) for t in clocks] or [np.zeros(0)]))
    if not gaps.size:
        return 0.0
    passed = np.cumsum(gaps)
    return float(gaps[int(np.searchsorted(passed, 0.25 * passed[-1]))])
