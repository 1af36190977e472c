"""Where a head holds its spindle as it physically is, and what to enter for it.

All places are those with the head at zero, in machine axes: the lines of the head's axes where
they lie and lean (`as_built`), and from the last of them the vector to the spindle. A controller
that holds lines, directions and vectors so is right with all of them entered; so is one that chains
them from line to line, for there the same vectors are the differences.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.effects import RotaryLocation, SpindleLocation
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.model.as_built import SURE, line_pose, stated_variance
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import joined, said

F64 = NDArray[np.float64]

_UNSEEN = 5e-10
_SAME_TOOL = 1e-3
"""mm within which tools count as one."""


@dataclass(frozen=True, eq=False)
class HeldSpindle:
    """Where a head holds its spindle, seen from the stated point of its last line.

    Attributes
    ----------
    axis
        The head's last axis, from whose line the vector counts.
    configured
        From the configured line to the spindle, head at zero, shape (3,), mm.
    offset, offset_sd
        What is to be added, shape (3,), mm; NaN where the uncertainty is not known.
    measured
        Of each direction whether the campaigns show it.
    tool
        The tool's offset for which it holds where the spindle leans with the head's lines, mm.
    """

    axis: str
    configured: F64
    offset: F64
    offset_sd: F64
    measured: tuple[bool, bool, bool]
    tool: F64

    @property
    def place(self) -> F64:
        """The vector from the line to the spindle as it is, shape (3,), mm: what to enter."""
        return self.configured + self.offset

    def _known(self, k: int) -> bool:
        sd = self.offset_sd[k]
        elsewhere = abs(self.offset[k]) > _UNSEEN
        return self.measured[k] and elsewhere and (np.isnan(sd) or abs(self.offset[k]) > SURE * sd)

    @property
    def entered(self) -> tuple[int, ...]:
        """The directions, 0 to 2, in which it is elsewhere and known well enough to be entered."""
        return tuple(k for k in range(3) if self._known(k))

    def words(self) -> Iterator[str]:
        """Sentences for people: what to enter."""
        if not self.entered:
            yield said(
                "the spindle sits in the head where it is configured, as far as was measured"
            )
            return
        entered = [
            said(
                "{axis} {place} instead of {configured} mm",
                axis="XYZ"[k], place=f"{self.place[k]:.4f}",
                configured=f"{self.configured[k] + 0.0:.4f}",
            )
            for k in self.entered
        ]  # fmt: skip
        yield said(
            "from the line of {axis} to the spindle (pivot length; the head at zero): enter "
            "{what}; with one tool this is the same as an error of that tool's offset",
            axis=self.axis, what=joined(entered, ", "),
        )  # fmt: skip


def tool_of(campaign: Campaign) -> F64:
    """The offset of the only tool of a campaign, shape (3,), mm; 0 where there are several."""
    tool = campaign.conditions.tool
    one = campaign.n > 0 and float(np.ptp(tool, axis=0).max()) < _SAME_TOOL
    return np.asarray(tool[0]) if one else np.zeros(3)


def head_of(machine: Machine) -> tuple[str, ...]:
    """The rotary axes between the bed and the tool, from the bed."""
    return tuple(a for a in machine.structure.tool_side if machine.axes[a].rotary)


def spindle_term(model: Model) -> int | None:
    """The index of a model's fitted `spindle_location`; None without."""
    return next(
        (
            i
            for i, t in enumerate(model.terms)
            if isinstance(t.effect, SpindleLocation) and t.fitted
        ),
        None,
    )


def held_spindle(model: Model, tool: F64 | None = None) -> HeldSpindle | None:
    """Where the head of a model with a fitted `spindle_location` holds its spindle; None without.

    The vector from the stated point of the last line to the spindle, all of them where they are
    with the head at zero: also what the lines' leans carry it beside, for whoever enters a line's
    direction does not turn the spindle with it.

    Parameters
    ----------
    tool
        The tool's offset for which it is to hold, shape (3,), mm; default the spindle itself.
    """
    at = spindle_term(model)
    if at is None:
        return None
    machine = model.machine
    tool = np.zeros(3) if tool is None else np.asarray(tool, dtype=np.float64)
    lines = {
        t.effect.axis: i
        for i, t in enumerate(model.terms)
        if isinstance(t.effect, RotaryLocation) and t.fitted
    }
    axis = head_of(machine)[-1]
    where = np.asarray(machine.axis(axis).location, dtype=np.float64)
    theta = np.array([v.value for t in model.terms for v in t.values.values()])
    block = np.zeros((3, len(theta)))
    start = sum(len(t.values) for t in model.terms[:at])
    # along the line of a head with one axis there is no unknown: what its lean carries is known
    measured = [f"E_{d}0S" not in model.terms[at].values for d in "XYZ"]
    for i, (name, value) in enumerate(model.terms[at].values.items()):
        k = "XYZ".index(name[2])
        block[k, start + i] += 1.0
        measured[k] = value.measured
    for other in head_of(machine):
        if other in lines:
            point = np.asarray(machine.axis(other).location)
            tip = line_pose(model, lines[other], tool - point, len(theta))
            line = line_pose(model, lines[other], where - point, len(theta))
            own = "ABC".index(own_component(axis))
            line[own] = 0.0  # along the line any of its points is as good
            block += tip[:3] - line[:3]
    sd, covariance = np.full(3, np.nan), model.covariance
    if covariance is not None:
        sd = np.sqrt(np.maximum(np.einsum("ip,pq,iq->i", block, covariance, block), 0.0))
    elif all(v.sd is not None for v in model.terms[at].values.values()):
        sd = np.sqrt(block**2 @ stated_variance(model))
    m0, m1, m2 = measured
    return HeldSpindle(axis, 0.0 - where, block @ theta, sd, (m0, m1, m2), tool)


def where_they_are(model: Model, *, placed: bool = False) -> Model:
    """A model with its lines where they are beside the spindle as it is, for who enters both.

    `spindle_location` leaves the tool right with the head at zero, p itself taken off. Who enters
    p in the vector to the spindle moves the tool by it, and a table's line has to be seen from
    there. Where spheres stand at known places (`placed`) so has a head's.
    """
    at = spindle_term(model)
    if at is None:
        return model
    names = [(i, n) for i, t in enumerate(model.terms) for n in t.values]
    where = {
        (t.effect.axis, n): k
        for k, (i, n) in enumerate(names)
        if isinstance((t := model.terms[i]).effect, RotaryLocation)
    }
    from_the_bed = reversed(model.machine.structure.workpiece_side)
    nearest = [*from_the_bed, *(head_of(model.machine) if placed else ())]
    move = np.eye(len(names))
    for row, (i, name) in enumerate(names):
        if i == at:
            places = (where.get((axis, f"E_{name[2]}0{axis}")) for axis in nearest)
            carrier = next((k for k in places if k is not None), None)
            if carrier is not None:
                move[carrier, row] -= 1.0
    return _linearly_moved(model, move)


def _linearly_moved(model: Model, move: F64) -> Model:
    """A model whose parameters are mixed by a matrix, shape (m, m), covariance with them."""
    names = [(i, n) for i, t in enumerate(model.terms) for n in t.values]
    theta = move @ np.array([model.terms[i].values[n].value for i, n in names])
    covariance = model.covariance
    sd = np.full(len(theta), np.nan)
    if covariance is not None:
        covariance = move @ covariance @ move.T
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    terms = list(model.terms)
    for k, (i, name) in enumerate(names):
        old = terms[i].values[name]
        value = replace(old, value=float(theta[k]), sd=None if np.isnan(sd[k]) else float(sd[k]))
        terms[i] = replace(terms[i], values={**terms[i].values, name: value})
    return replace(model, terms=tuple(terms), covariance=covariance)
