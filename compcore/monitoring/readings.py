"""Check measurements as series: the same place read in the same direction, again and again.

What is read is laid beside the model's prediction. Rows are gathered twice: those of one hour are
one *check*, and those that read the same place, direction and tool in all checks are one *series*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.design.nuisance import SetupNuisances, setup_blocks
from abbe.compcore.fitting.design.observation import Observation, with_tools
from abbe.compcore.fitting.design.weights import Uncertainty
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.model.sensitivity import covariance_root, sensitivities
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

ONE_CHECK = 3600.0
"""Readings within so many seconds of a check's first are of that check."""
PLACING = "@"
"""What follows it in a set-up's name tells one placing of an instrument from the next."""
_NEAR = 2.0
"""mm within which readings are of one place: a probed sphere is never found at the same count."""
_NEAR_ANGLE = 1e-2
"""rad, likewise."""
_ALIKE = 0.999
"""Cosine from which on two measured directions are one."""
_MOST = 48
"""Series beyond which neighbours on a line are taken together."""


@dataclass(frozen=True, slots=True)
class Series:
    """One place that is checked in one direction.

    Attributes
    ----------
    name
        For people: ``sphere in Y``, ``diagonal at X 300, Y 300``.
    setup
        Its set-up, without what tells one placing from the next.
    unit
        ``µm`` or ``µrad``.
    """

    name: str
    setup: str
    unit: str


@dataclass(frozen=True, eq=False)
class CheckReadings:
    """Readings of all checks beside the prediction, row by row; lengths in µm, angles in µrad.

    Attributes
    ----------
    campaign
        The rows, in order of time.
    check
        Shape (n,): which check each row belongs to, from 0.
    times
        Shape (number of checks,): when each began, s.
    series
        What is read.
    of
        Shape (n,): the series of each row.
    residual, sd
        Shape (n,): measured less predicted, and the standard uncertainty of the measurement.
    influence
        Shape (n, q): what q independent standard normal unknowns, the parameters' errors, do to
        each row. q = 0 where the model has no covariance.
    placings
        What the placing of each instrument leaves unknown, columns in µm or µrad.
    left_over
        For each series what the model's fit left over, µm or µrad; 0 where that is not known.
    """

    campaign: Campaign
    check: Index
    times: F64
    series: tuple[Series, ...]
    of: Index
    residual: F64
    sd: F64
    influence: F64
    placings: tuple[SetupNuisances, ...]
    left_over: F64

    @property
    def stays(self) -> NDArray[np.bool_]:
        """Rows whose placing is that of other checks too, or leaves nothing unknown, (n,)."""
        found = np.ones(len(self.check), dtype=np.bool_)
        for block in self.placings:
            found[block.rows] = len(np.unique(self.check[block.rows])) > 1
        return found

    @property
    def predicted_sd(self) -> F64:
        """Standard uncertainty of each row's prediction, (n,), µm or µrad."""
        square = (self.influence**2).sum(axis=1) + self.left_over[self.of] ** 2
        return np.asarray(np.sqrt(square))


def check_readings(model: Model, campaign: Campaign) -> CheckReadings:
    """Lay check measurements beside a model's prediction.

    Parameters
    ----------
    model
        Effects of the instrument are left out: its placing is not that of the campaign fitted.
    campaign
        Displacements and rotations; one clock for all, s.

    Raises
    ------
    InputError
        When a row measures a distance from a base point, or lacks a signal of the model.
    """
    campaign = _in_order(campaign)
    check = _checks(campaign.conditions.time)
    # a check's past is not known: its thermometers have been where they are for long
    conditions = replace(campaign.conditions, run=check, stretch=None)
    if campaign.tools:
        offsets = {name: np.array(tool.offset) for name, tool in campaign.tools.items()}
        conditions = with_tools(conditions, campaign.tool_name, offsets)
    rotation = campaign.kind == Kind.ROTATION
    unit = np.where(rotation, 1e6, 1e3)
    u = conditions.u if conditions.u is not None else np.zeros((campaign.n, 3))
    predicted = model.predict(conditions)
    value = np.where(rotation[:, None], predicted.rotation, predicted.translation)
    residual = campaign.value - np.einsum("ni,ni->n", u, value)
    of, series = _series(campaign)
    blocks = setup_blocks(campaign, Observation(model.machine, campaign, conditions, {}))
    sd = Uncertainty.of(campaign, model.machine).sd
    return CheckReadings(
        campaign,
        check,
        campaign.conditions.time[np.unique(check, return_index=True)[1]],
        series,
        of,
        residual * unit,
        sd * unit,
        _influence(model, conditions, u, rotation) * unit[:, None],
        tuple(replace(b, columns=b.columns * unit[b.rows, None]) for b in blocks if b.names),
        _left_over(model, series),
    )


def _in_order(campaign: Campaign) -> Campaign:
    if not np.isin(campaign.kind, (Kind.DISPLACEMENT, Kind.ROTATION)).all():
        row = int(np.flatnonzero(campaign.kind >= Kind.DISTANCE)[0])
        raise InputError(
            "a distance from a base point is no check measurement",
            file=campaign.file_of(row),
            line=int(campaign.line[row]),
            field="kind",
            found=Kind(campaign.kind[row]).name.lower(),
            expected="displacement or rotation",
        )
    return campaign.rows(np.argsort(campaign.conditions.time, kind="stable"))


def _checks(time: F64) -> Index:
    """Number the checks of rising times (n,)."""
    number = np.zeros(time.shape[0], dtype=np.int64)
    began = time[0]
    for row in range(1, time.shape[0]):
        late = time[row] - began >= ONE_CHECK
        began = time[row] if late else began
        number[row] = number[row - 1] + late
    return number


def _influence(model: Model, conditions: Conditions, u: F64, rotation: NDArray[np.bool_]) -> F64:
    if model.covariance is None:
        return np.zeros((conditions.n, 0))
    moved, turned = sensitivities(model, conditions)
    columns = np.where(rotation[:, None, None], turned, moved)
    seen = np.einsum("ni,nip->np", u, columns)
    return np.asarray(seen @ covariance_root(model.covariance))


def _left_over(model: Model, series: Sequence[Series]) -> F64:
    known = {
        "µm": float(model.fit.get("rms") or 0.0),
        "µrad": float(model.fit.get("rms_rotation_urad") or 0.0),
    }
    return np.array([known[s.unit] for s in series])


def _series(campaign: Campaign) -> tuple[Index, tuple[Series, ...]]:
    """The series of each row, and all series in order of their first reading."""
    keys = _keys(campaign)
    first: list[int] = []
    of = np.zeros(campaign.n, dtype=np.int64)
    for row in range(campaign.n):
        for k, other in enumerate(first):
            if keys.same(row, other):
                of[row] = k
                break
        else:
            of[row] = len(first)
            first.append(row)
    of, first = _together(of, first, keys)
    return of, tuple(keys.named(row, first) for row in first)


@dataclass(frozen=True, eq=False)
class _Keys:
    """What tells the series of rows apart."""

    setup: list[str]
    kind: NDArray[np.int8]
    u: F64
    place: F64
    near: F64
    tool: F64
    axes: tuple[str, ...]

    def same_line(self, row: int, other: int) -> bool:
        """Whether two rows measure the same with one placing, perhaps elsewhere."""
        return (
            self.setup[row] == self.setup[other]
            and self.kind[row] == self.kind[other]
            and float(self.u[row] @ self.u[other]) > _ALIKE
            and bool((np.abs(self.tool[row] - self.tool[other]) < _NEAR).all())
        )

    def same(self, row: int, other: int) -> bool:
        """Whether two rows belong to one series."""
        near = np.abs(self.place[row] - self.place[other]) < self.near
        return bool(near.all()) and self.same_line(row, other)

    def named(self, row: int, first: Sequence[int]) -> Series:
        """The series that begins with a row."""
        unit = "µrad" if self.kind[row] == Kind.ROTATION else "µm"
        name = self.setup[row]
        if sum(self.setup[other] == name for other in first) > 1:
            name += f" {'about' if unit == 'µrad' else 'in'} {direction_name(self.u[row])}"
        beside = [o for o in first if o != row and self.same_line(row, o)]
        far = [
            k
            for k in range(len(self.axes))
            if any(abs(self.place[row, k] - self.place[o, k]) >= self.near[k] for o in beside)
        ]
        if far:
            name += " at " + ", ".join(self._stands(row, k) for k in far)
        return Series(name, self.setup[row], unit)

    def _stands(self, row: int, k: int) -> str:
        axis, at = self.axes[k], self.place[row, k]
        return f"{axis} {in_digits(np.degrees(at) if is_rotary(axis) else at, 5)}"


def _keys(campaign: Campaign) -> _Keys:
    c = campaign.conditions
    setup = [""] * c.n if c.setup is None else [str(s).split(PLACING)[0] for s in c.setup]
    axes = tuple(c.positions)
    return _Keys(
        setup,
        campaign.kind,
        np.zeros((c.n, 3)) if c.u is None else c.u,
        np.stack([c.positions[a] for a in axes], axis=1),
        np.array([_NEAR_ANGLE if is_rotary(a) else _NEAR for a in axes]),
        c.tool,
        axes,
    )


def _together(of: Index, first: list[int], keys: _Keys) -> tuple[Index, list[int]]:
    """Neighbours on a line as one series, until there are no more than can be followed."""
    while len(first) > _MOST:
        lines: list[list[int]] = []
        for k, row in enumerate(first):
            line = next((x for x in lines if keys.same_line(first[x[0]], row)), None)
            if line is None:
                lines.append([k])
            else:
                line.append(k)
        if all(len(line) == 1 for line in lines):
            break
        number = np.zeros(len(first), dtype=np.int64)
        kept: list[int] = []
        for line in lines:
            at = keys.place[[first[k] for k in line]]
            along = np.argsort(at @ _main_direction(at), kind="stable")
            for i in range(0, len(line), 2):
                number[[line[j] for j in along[i : i + 2]]] = len(kept)
                kept.append(first[line[along[i]]])
        of, first = number[of], kept
    return of, first


def _main_direction(points: F64) -> F64:
    spread = np.ptp(points, axis=0)
    return np.asarray((spread == spread.max()).astype(np.float64))


def direction_name(u: F64) -> str:
    """A direction in words: X, −Z, or its components where it is oblique."""
    k = int(np.abs(u).argmax())
    if abs(u[k]) > _ALIKE:
        return f"{'−' if u[k] < 0 else ''}{'XYZ'[k]}"
    return "(" + ", ".join(in_digits(c, 2) for c in u) + ")"
