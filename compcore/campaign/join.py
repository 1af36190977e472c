"""Several campaigns as one: separate clocks, names made unique."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Setup, Tool
from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]
Names = Mapping[str, str]


def join_campaigns(campaigns: Sequence[Campaign]) -> Campaign:
    """One campaign of all rows, each file a run with a clock of its own.

    A name belongs to its file: the same set-up, base point or tool name in two files is two
    placings. The first keeps its name, later ones become ``name@file`` (``name@file#2`` when even
    that is taken). But a gauge of the same name is the same gauge. Signals that some file lacks are
    left out and listed in `lacking`; directions that a file does not record are 0 (unknown) there.
    """
    if len(campaigns) == 1:
        return campaigns[0]
    taken: dict[str, set[str]] = {"setups": set(), "bases": set(), "tools": set()}
    parts = [_renamed(c, taken) for c in campaigns]
    runs: list[NDArray[np.int64]] = []
    stretches: list[NDArray[np.int64]] = []
    for part in parts:
        for numbers, own in ((runs, _run(part)), (stretches, part.conditions.stretches)):
            numbers.append(own - own.min() + (numbers[-1].max() + 1 if numbers else 0))
    table = [part.conditions for part in parts]
    axes = list(table[0].positions)
    reversing = list(dict.fromkeys(a for c in table for a in c.directions))
    recorded = list(dict.fromkeys(s for c in table for s in c.signals))
    everywhere = [s for s in recorded if all(s in c.signals for c in table)]
    conditions = Conditions(
        positions={a: np.concatenate([c.position(a) for c in table]) for a in axes},
        directions={a: np.concatenate([c.direction(a) for c in table]) for a in reversing},
        tool=np.concatenate([c.tool for c in table]),
        time=np.concatenate([c.time for c in table]),
        signals={s: np.concatenate([c.signals[s] for c in table]) for s in everywhere},
        spindle_angle=_spindle(table),
        run=np.concatenate(runs),
        stretch=np.concatenate(stretches),
        setup=np.concatenate([_names(c.setup, c.n) for c in table]),
        u=np.concatenate([np.zeros((c.n, 3)) if c.u is None else c.u for c in table]),
        base=np.concatenate([_names(c.base, c.n) for c in table]),
    )
    unseen = {s: row for p in reversed(parts) for s, row in p.unseen.items()}
    lacking = {s: tuple(files) for p in parts for s, files in p.lacking.items()}
    for signal in recorded:
        if signal not in everywhere:
            without = [f for p in parts if signal not in p.conditions.signals for f in p.files]
            lacking[signal] = tuple(without)
    no_gauge = all(p.gauge is None for p in parts)
    return Campaign(
        name=" + ".join(c.name for c in campaigns),
        conditions=conditions,
        kind=np.concatenate([p.kind for p in parts]),
        value=np.concatenate([p.value for p in parts]),
        sd=np.concatenate([p.sd for p in parts]),
        base2=np.concatenate([p.base2 for p in parts]),
        tool_name=np.concatenate([p.tool_name for p in parts]),
        line=np.concatenate([p.line for p in parts]),
        setups={k: v for p in parts for k, v in p.setups.items()},
        bases={k: v for p in parts for k, v in p.bases.items()},
        tools={k: v for p in parts for k, v in p.tools.items()},
        files={k: v for p in parts for k, v in p.files.items()},
        metadata=[m for p in parts for m in p.metadata],
        spindle=next((p.spindle for p in parts if p.spindle), None),
        lacking=lacking,
        unseen=unseen,
        # one gauge measured in several files is one gauge
        gauge=None if no_gauge else np.concatenate([_names(p.gauge, p.n) for p in parts]),
        gauge_sd=None if no_gauge else np.concatenate([_zeros(p.gauge_sd, p.n) for p in parts]),
    )


def _run(campaign: Campaign) -> NDArray[np.int64]:
    run = campaign.conditions.run
    return np.zeros(campaign.n, dtype=np.int64) if run is None else run


def _names(names: NDArray[np.str_] | None, n: int) -> NDArray[np.str_]:
    return np.zeros(n, dtype="<U1") if names is None else names


def _zeros(values: F64 | None, n: int) -> F64:
    return np.zeros(n) if values is None else values


def _spindle(table: Sequence[Conditions]) -> F64 | None:
    if all(c.spindle_angle is None for c in table):
        return None
    return np.concatenate(
        [np.zeros(c.n) if c.spindle_angle is None else c.spindle_angle for c in table]
    )


def _renamed(campaign: Campaign, taken: dict[str, set[str]]) -> Campaign:
    suffix = campaign.name.removesuffix(".csv")
    setups = _unique(campaign.setups, taken["setups"], suffix)
    bases = _unique(campaign.bases, taken["bases"], suffix)
    tools = _unique(campaign.tools, taken["tools"], suffix)
    conditions = replace(
        campaign.conditions,
        setup=_replaced(_names(campaign.conditions.setup, campaign.n), setups),
        base=_replaced(_names(campaign.conditions.base, campaign.n), bases),
    )
    return replace(
        campaign,
        conditions=conditions,
        base2=_replaced(campaign.base2, bases),
        tool_name=_replaced(campaign.tool_name, tools),
        setups={new: Setup(new, campaign.setups[old].free) for old, new in setups.items()},
        bases={new: campaign.bases[old] for old, new in bases.items()},
        tools={
            new: Tool(new, campaign.tools[old].offset, campaign.tools[old].free)
            for old, new in tools.items()
        },
    )


def _unique(names: Mapping[str, object], taken: set[str], suffix: str) -> Names:
    found: dict[str, str] = {}
    for name in names:
        new, count = name, 1
        while new in taken:
            new = f"{name}@{suffix}" if count == 1 else f"{name}@{suffix}#{count}"
            count += 1
        taken.add(new)
        found[name] = new
    return found


def _replaced(column: NDArray[np.str_], names: Names) -> NDArray[np.str_]:
    changed = {old: new for old, new in names.items() if old != new}
    if not changed:
        return column
    unique, inverse = np.unique(column, return_inverse=True)
    texts = [changed.get(name, name) for name in unique.tolist()]
    return np.array(texts, dtype=np.str_)[inverse]
