"""A campaign that goes on: more rows by the same clock, with the same artefacts and placings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions

_UNREAD = "so that all rows can be laid beside one model"


def continued(before: Campaign, after: Campaign) -> Campaign:
    """One campaign of both: a set-up, base point or tool of one name is the same in both.

    The earlier rows stay as they are. Signals that only later rows have are left out.

    Raises
    ------
    InputError
        When the later rows lack an axis or a signal of the earlier ones, mean another set-up or
        tool by a name, or are there already.
    """
    one, two = before.conditions, after.conditions
    for axis in one.positions:
        if axis not in two.positions:
            raise InputError("an axis of the checks before is missing", field=axis)
    missing = [name for name in one.signals if name not in two.signals]
    if missing:
        raise InputError(
            f"the checks before recorded {', '.join(missing)}, and this one does not",
            field=missing[0],
            expected=f"{' '.join(f'{name}=..' for name in missing)}, {_UNREAD}",
        )
    for name, setup in after.setups.items():
        known = before.setups.get(name)
        if known is not None and known.free != setup.free:
            raise InputError(
                "a set-up that leaves something else unknown than before",
                field=f"setups.{name}.free",
                found=list(setup.free),
                expected=f"{list(known.free)}, or another name",
            )
    for name, tool in after.tools.items():
        if before.tools.get(name, tool) != tool:
            raise InputError("another tool than before by that name", field=f"tools.{name}")
    _require_new(before, after)
    reversing = [a for a in one.positions if a in one.directions or a in two.directions]
    spindle = None
    if one.spindle_angle is not None or two.spindle_angle is not None:
        angles = [np.zeros(c.n) if c.spindle_angle is None else c.spindle_angle for c in (one, two)]
        spindle = np.concatenate(angles)
    names = [
        [np.zeros(c.n, dtype="<U1") if n is None else n for c, n in pair]
        for pair in (((one, one.setup), (two, two.setup)), ((one, one.base), (two, two.base)))
    ]
    conditions = Conditions(
        positions={a: np.concatenate([q, two.positions[a]]) for a, q in one.positions.items()},
        directions={a: np.concatenate([one.direction(a), two.direction(a)]) for a in reversing},
        tool=np.concatenate([one.tool, two.tool]),
        time=np.concatenate([one.time, two.time]),
        signals={s: np.concatenate([v, two.signals[s]]) for s, v in one.signals.items()},
        spindle_angle=spindle,
        setup=np.concatenate(names[0]),
        u=np.concatenate([np.zeros((c.n, 3)) if c.u is None else c.u for c in (one, two)]),
        base=np.concatenate(names[1]),
    )
    return replace(
        before,
        conditions=conditions,
        kind=np.concatenate([before.kind, after.kind]),
        value=np.concatenate([before.value, after.value]),
        sd=np.concatenate([before.sd, after.sd]),
        base2=np.concatenate([before.base2, after.base2]),
        tool_name=np.concatenate([before.tool_name, after.tool_name]),
        line=np.concatenate([before.line, after.line]),
        setups={**before.setups, **after.setups},
        bases={**before.bases, **after.bases},
        tools={**before.tools, **after.tools},
        spindle=before.spindle or after.spindle,
    )


def _require_new(before: Campaign, after: Campaign) -> None:
    def keys(campaign: Campaign) -> list[tuple[object, ...]]:
        c = campaign.conditions
        setup = [""] * c.n if c.setup is None else c.setup.tolist()
        place = zip(*(q.tolist() for q in c.positions.values()), strict=True)
        return list(zip(c.time.tolist(), setup, place, campaign.value.tolist(), strict=True))

    there = set(keys(before))
    for row, key in enumerate(keys(after)):
        if key in there:
            raise InputError(
                "these readings are there already",
                file=after.file_of(row) if after.files else None,
                line=int(after.line[row]) if after.files else None,
                expected="readings that were not taken before",
            )
