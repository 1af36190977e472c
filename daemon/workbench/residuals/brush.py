"""Which of many residuals a person has chosen: a box drawn over a picture, or a row of a table.

Every row of the campaign is asked, by its exact value, not only those that are drawn one by one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from abbe.compcore.campaign.campaign import LENGTHS, Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.figures.places import places
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.workbench.entrance.asked import AskedOfWorkbench
from abbe.daemon.workbench.residuals.cells import (
    CellPicture,
    Mask,
    across,
    cell_picture,
    share_rows,
)

F64 = NDArray[np.float64]

_NAMED = 3
"""Set-ups that are named, those with the most rows."""
_NEAR = 1e-6
"""By which a value may lie outside of a table's ends, in the table's unit."""
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Four = Annotated[list[float], Field(min_length=4, max_length=4)]


class BrushedBox(AskedOfWorkbench):
    """A box over a picture: its ends across, and up in µm or µrad."""

    panel: int
    x: Pair
    y: Pair


class BrushedGroup(AskedOfWorkbench):
    """A row of a table, both by their places."""

    table: int
    row: int


class BrushedSpace(AskedOfWorkbench):
    """A box over the volume as it is turned.

    `right` and `up` make screen co-ordinates of X, Y, Z and 1; `long` is the length of an arrow in
    mm for each µm or µrad.
    """

    part: int
    right: Four
    up: Four
    long: float
    x: Pair
    y: Pair


class Brush(AskedOfWorkbench):
    """What was chosen, one of three ways, and the pictures in which it is to be seen."""

    box: BrushedBox | None = None
    group: BrushedGroup | None = None
    space: BrushedSpace | None = None
    panels: list[int] = Field(default_factory=list, max_length=500)


class ManyResiduals:
    """All residuals of a comparison whose pictures show only some one by one.

    Parameters
    ----------
    campaign, machine, residual
        The rows, the machine that stood there, and what the model leaves of each, mm or rad.
    panels
        The pictures, as `rows.panels` lists them.
    shown
        Rows that are drawn one by one.
    tables
        For each table what makes a row one of each of its groups.
    """

    def __init__(
        self,
        campaign: Campaign,
        machine: Machine,
        residual: F64,
        panels: Sequence[Mapping[str, Any]],
        shown: NDArray[np.int64],
        tables: Sequence[Sequence[Mapping[str, Any]]],
    ) -> None:
        self._campaign, self._machine = campaign, machine
        self._shown, self._tables = shown, tables
        self._length = np.isin(campaign.kind, LENGTHS)
        self._value = residual * np.where(self._length, 1e3, 1e6)
        component = campaign.measured_components()
        size = np.abs(np.nan_to_num(self._value))
        reach = np.array(
            [
                1.05 * float(size[mine].max(initial=0.0)) or 1.0
                for mine in (self._length, ~self._length)
            ]
        )
        self._panels = list(panels)
        self._pictures: list[CellPicture] = [
            cell_picture(campaign, panel, self._value, component, reach) for panel in panels
        ]
        share_rows(self._pictures)

    def pictures(self) -> list[dict[str, Any]]:
        """All rows, counted, picture by picture."""
        return [picture.as_json() for picture in self._pictures]

    def brushed(self, brush: Brush) -> dict[str, Any]:
        """How many rows are chosen, how large, where, and in which cells of the pictures asked for.

        Raises
        ------
        InputError
            For a picture or a table that is not there.
        """
        chosen = self._chosen(brush) & np.isfinite(self._value)
        return {
            "n": int(chosen.sum()),
            "parts": [self._figures(part, chosen) for part in (0, 1)],
            "setups": self._setups(chosen),
            "rows": np.flatnonzero(chosen[self._shown]).tolist(),
            "panels": {k: self._picture(k).counted(chosen) for k in brush.panels},
        }

    def _chosen(self, brush: Brush) -> Mask:
        if brush.box is not None:
            picture = self._picture(brush.box.panel)
            at = across(self._campaign, self._panels[brush.box.panel])
            chosen = np.zeros(self._campaign.n, dtype=np.bool_)
            rows = picture.rows
            chosen[rows] = _inside(at[rows], brush.box.x) & _inside(self._value[rows], brush.box.y)
            return chosen
        if brush.group is not None:
            group = brush.group
            if not (
                0 <= group.table < len(self._tables)
                and 0 <= group.row < len(self._tables[group.table])
            ):
                raise InputError("no such row of a table", field="group", found=group.model_dump())
            return self._of(self._tables[group.table][group.row])
        if brush.space is not None:
            return self._in_space(brush.space)
        raise InputError("nothing is chosen", expected="box, group or space")

    def _picture(self, number: int) -> CellPicture:
        if not 0 <= number < len(self._pictures):
            raise InputError("no such picture", field="panel", found=number)
        return self._pictures[number]

    def _of(self, wanted: Mapping[str, Any]) -> Mask:
        """Rows that are what a table's row says."""
        c = self._campaign.conditions
        chosen = np.ones(self._campaign.n, dtype=np.bool_)
        if "row" in wanted:
            return np.asarray(np.arange(self._campaign.n) == wanted["row"])
        if "part" in wanted:
            chosen &= self._length == (wanted["part"] == 0)
        if "setup" in wanted:
            return chosen if c.setup is None else chosen & c.setup_rows().mask(wanted["setup"])
        if "direction" in wanted:
            side = c.direction(wanted["axis"]) == wanted["direction"]
            own = self._campaign.measured_components() == wanted["measured"]
            return np.asarray(chosen & side & own)
        if "signal" in wanted:
            at = c.signals[wanted["signal"]]
        elif "axis" in wanted:
            at = c.position(wanted["axis"])
            at = np.degrees(at) if is_rotary(wanted["axis"]) else at
        elif "from" in wanted:
            at = c.time
        else:
            return np.zeros_like(chosen)
        # a part has its lower end; its upper one is the next part's
        below = wanted["to"] + _NEAR if wanted["last"] else wanted["to"] - _NEAR
        return np.asarray(chosen & (at >= wanted["from"] - _NEAR) & (at < below))

    def _in_space(self, space: BrushedSpace) -> Mask:
        """Rows whose arrow begins or ends in the box."""
        foot = places(self._campaign, self._machine)
        u = self._campaign.conditions.u
        head = foot if u is None else foot + u * (space.long * np.nan_to_num(self._value))[:, None]
        found = np.zeros(len(foot), dtype=np.bool_)
        for point in (foot, head):
            right, up = (point @ np.array(to[:3]) + to[3] for to in (space.right, space.up))
            found |= _inside(right, space.x) & _inside(up, space.y)
        return np.asarray(found & (self._length == (space.part == 0)))

    def _figures(self, part: int, chosen: Mask) -> dict[str, Any] | None:
        own = self._value[chosen & (self._length == (part == 0))]
        if not own.size:
            return None
        return {
            "n": int(own.size),
            "rms": float(np.sqrt(np.mean(own**2))),
            "mean": float(own.mean()),
        }

    def _setups(self, chosen: Mask) -> dict[str, Any]:
        c = self._campaign.conditions
        if c.setup is None:
            return {"most": [""], "more": 0}
        setups = c.setup_rows()
        names = list(setups.index)
        count = np.bincount(setups.number[chosen], minlength=len(names))
        most = [names[k] for k in np.argsort(-count, kind="stable") if count[k]]
        return {"most": most[:_NAMED], "more": max(0, len(most) - _NAMED)}


def _inside(values: F64, ends: Sequence[float]) -> Mask:
    return np.asarray((values >= min(ends)) & (values <= max(ends)))
